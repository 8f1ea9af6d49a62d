"""Same numbers, fewer Python loops: replacements for inner loops of OmniSafe, in place only while it trains."""

from __future__ import annotations

import contextlib
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import scipy.signal
import torch
from torch.utils.data import TensorDataset

from algorithms.omnisafe_library import omnisafe_module


class ShuffledBatches:
    """What `torch.utils.data.DataLoader` gives for tensors, one indexing per batch instead of one per sample.

    It draws from torch's global generator in the same order, so that the batches are the same.
    """

    def __init__(self, dataset: TensorDataset, batch_size: int, shuffle: bool) -> None:
        """Take tensors of equal length; only shuffled batches are needed here."""
        if not shuffle:
            raise ValueError("shuffle = False: only shuffled batches are implemented.")
        self._tensors = dataset.tensors
        self._batch_size = batch_size

    def __iter__(self) -> Iterator[list[torch.Tensor]]:
        """One pass in a new random order; the last batch may be smaller."""
        torch.empty((), dtype=torch.int64).random_()  # the seed that DataLoader draws for its workers
        generator = torch.Generator()
        generator.manual_seed(int(torch.empty((), dtype=torch.int64).random_().item()))
        for indices in torch.randperm(len(self._tensors[0]), generator=generator).split(self._batch_size):
            yield [tensor[indices] for tensor in self._tensors]


def discounted_sums(values: torch.Tensor, discount: float) -> torch.Tensor:
    """Sum of what follows each entry, discounted: y_t = x_t + discount * y_(t+1), in double precision.

    Args:
        values: Shape (T,).
        discount: In [0, 1].
    """
    backwards = values.to(torch.float64).numpy()[::-1]
    return torch.from_numpy(scipy.signal.lfilter([1.0], [1.0, -discount], backwards)[::-1].copy())


def joined_storage(vector_buffer: type[Any]) -> type[Any]:
    """OmniSafe's buffer of N worlds with one array per quantity, shape (T, N, ...), instead of N arrays.

    The worlds' own buffers become views of it, so that a step is stored by one assignment per quantity.
    """

    class JoinedBuffer(vector_buffer):  # type: ignore[misc]
        def __init__(self, *arguments: Any, **keywords: Any) -> None:
            super().__init__(*arguments, **keywords)
            names = self.buffers[0].data
            self._joined = {name: torch.stack([b.data[name] for b in self.buffers], 1) for name in names}
            for world, buffer in enumerate(self.buffers):
                buffer.data = {name: values[:, world] for name, values in self._joined.items()}

        def store(self, **data: torch.Tensor) -> None:
            time = self.buffers[0].ptr
            for name, values in data.items():
                self._joined[name][time] = values
            for buffer in self.buffers:
                buffer.ptr += 1

    return JoinedBuffer


def without_display(sequence: Iterable[Any], description: str = "") -> Iterable[Any]:
    """Stands in for rich's `track`: its display has a thread, and would draw into that of our own command line."""
    return sequence


def lean_step(
    agent: Any, obs: torch.Tensor, deterministic: bool = False
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """OmniSafe's `ConstraintActorCritic.step` without what surrounds the matrix products; the same numbers.

    Args:
        agent: The actor-critic, with a Gaussian actor.
        obs: Shape (N, observation), or one observation.
        deterministic: Take the mean action.

    Returns:
        Action, value of reward and of cost, log probability of the action.
    """
    with torch.no_grad():
        value_r, value_c = (
            _through(critic.net_lst[0], obs).squeeze(-1) for critic in (agent.reward_critic, agent.cost_critic)
        )
        mean, deviation = _through(agent.actor.mean, obs), torch.exp(agent.actor.log_std)
        action = mean if deterministic else mean + torch.randn_like(mean) * deviation
        squares = (action - mean) ** 2 / (2 * deviation**2)
        log_density = -squares - deviation.log() - math.log(math.sqrt(2 * math.pi))
        return action, value_r, value_c, log_density.sum(dim=-1)


def _through(network: torch.nn.Sequential, values: torch.Tensor) -> torch.Tensor:
    """A network's output, its layers called directly."""
    for layer in network:
        if isinstance(layer, torch.nn.Linear):
            values = torch.nn.functional.linear(values, layer.weight, layer.bias)
        elif isinstance(layer, torch.nn.ReLU):
            values = values.relu_()  # what it overwrites is the layer's before it
        elif not isinstance(layer, torch.nn.Identity):
            values = layer(values)
    return values


@dataclass(frozen=True, slots=True)
class _Moment:
    """What an actor's output depends on.

    Attributes:
        observations: The very tensor.
        parameters: Copies of the actor's.
    """

    observations: torch.Tensor
    parameters: tuple[torch.Tensor, ...]

    @classmethod
    def of(cls, actor: Any, observations: torch.Tensor) -> _Moment:
        return cls(observations, tuple(parameter.detach().clone() for parameter in actor.parameters()))

    def holds(self, actor: Any, observations: torch.Tensor) -> bool:
        """Whether neither observations nor parameters are others by now."""
        pairs = zip(self.parameters, actor.parameters(), strict=True)
        return self.observations is observations and all(torch.equal(copy, now) for copy, now in pairs)


@dataclass(frozen=True, slots=True)
class _Curvature:
    """The gradient of KL to the present policy, with its graph; every Fisher product of an actor's update needs it.

    Attributes:
        moment: Policy and observations that it holds for.
        kl: The divergence, zero but for rounding.
        gradient: Shape (parameters,), zero in value; its own gradient is the Fisher matrix.
    """

    moment: _Moment
    kl: float
    gradient: torch.Tensor

    @classmethod
    def of(cls, actor: Any, observations: torch.Tensor) -> _Curvature:
        policy = actor(observations)
        fixed = torch.distributions.Normal(policy.mean.detach(), policy.stddev.detach())
        kl = torch.distributions.kl.kl_divergence(fixed, policy).mean()
        parameters = tuple(actor.parameters())
        gradients = torch.autograd.grad(kl, parameters, create_graph=True)
        flat = torch.cat([gradient.view(-1) for gradient in gradients])
        return cls(_Moment.of(actor, observations), kl.item(), flat)


def fisher_product(trainer: Any, vector: torch.Tensor) -> torch.Tensor:
    """OmniSafe's `NaturalPG._fvp`, the same numbers; what does not depend on the vector is computed once an update.

    Args:
        trainer: The algorithm, with `_fvp_obs` set.
        vector: Shape (parameters,).

    Returns:
        Fisher matrix times vector, damping included; shape (parameters,).
    """
    actor = trainer._actor_critic.actor
    actor.zero_grad()
    curvature: _Curvature | None = getattr(trainer, "_curvature", None)
    if curvature is None or not curvature.moment.holds(actor, trainer._fvp_obs):
        trainer._curvature = curvature = _Curvature.of(actor, trainer._fvp_obs)
    along = (curvature.gradient * vector).sum()
    products = torch.autograd.grad(along, tuple(actor.parameters()), retain_graph=True)
    trainer._logger.store({"Train/KL": curvature.kl})
    flat = torch.cat([product.contiguous().view(-1) for product in products])
    damping: float = trainer._cfgs.algo_cfgs.cg_damping
    return flat + damping * vector


def remembering(distribution: Callable[[Any, torch.Tensor], Any]) -> Callable[[Any, torch.Tensor], Any]:
    """An actor's `_distribution` that answers the same question once: a line search asks three times at each step.

    Only without gradients: a graph can be gone through once.
    """

    def remembered(actor: Any, observations: torch.Tensor) -> Any:
        if torch.is_grad_enabled():
            return distribution(actor, observations)
        before: tuple[_Moment, Any] | None = getattr(actor, "_remembered", None)
        if before is None or not before[0].holds(actor, observations):
            before = _Moment.of(actor, observations), distribution(actor, observations)
            actor._remembered = before
        return before[1]

    return remembered


def deterministic_algorithms(mode: bool) -> None:
    """`torch.use_deterministic_algorithms` without its import of torch's compiler, which nothing here uses."""
    torch.set_deterministic_debug_mode("error" if mode else "default")


class SilentConsole:
    """Stands in for rich's `Console`, which would lay out tables and texts that nobody sees."""

    def print(self, *_texts: Any, **_style: Any) -> None:
        """Nothing."""


def _replacements() -> list[tuple[Any, str, Any]]:
    """Module, name and replacement of everything that is replaced."""
    buffers = omnisafe_module("omnisafe.common.buffer.onpolicy_buffer")
    base = omnisafe_module("omnisafe.algorithms.on_policy.base.policy_gradient")
    gaussian = omnisafe_module("omnisafe.models.actor.gaussian_learning_actor").GaussianLearningActor
    found: list[tuple[Any, str, Any]] = [
        (buffers, "discount_cumsum", discounted_sums),
        (base, "VectorOnPolicyBuffer", joined_storage(base.VectorOnPolicyBuffer)),
        (omnisafe_module("omnisafe.common.logger"), "Console", SilentConsole),
        (omnisafe_module("omnisafe.algorithms.on_policy.base.natural_pg").NaturalPG, "_fvp", fisher_product),
        (gaussian, "_distribution", remembering(gaussian._distribution)),
        (torch, "use_deterministic_algorithms", deterministic_algorithms),
        (omnisafe_module("omnisafe.models.actor_critic").ConstraintActorCritic, "step", lean_step),
    ]
    for module_name, module in sys.modules.items():
        if module_name.startswith(("omnisafe.algorithms.on_policy.", "omnisafe.adapter.")):
            for name, value in (("DataLoader", ShuffledBatches), ("track", without_display)):
                if hasattr(module, name):
                    found.append((module, name, value))
    return found


@contextlib.contextmanager
def fast_loops() -> Iterator[None]:
    """Put the replacements in place; OmniSafe's own come back afterwards.

    torch's validation of distributions, a fifth of a roll-out, is off meanwhile: the environment refuses actions
    that are not finite.
    """
    replaced = _replacements()
    originals = [(module, name, getattr(module, name)) for module, name, _ in replaced]
    validated = torch.distributions.Distribution._validate_args
    try:
        for module, name, value in replaced:
            setattr(module, name, value)
        torch.distributions.Distribution.set_default_validate_args(False)
        yield
    finally:
        torch.distributions.Distribution.set_default_validate_args(validated)
        for module, name, value in originals:
            setattr(module, name, value)

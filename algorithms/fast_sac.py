"""stable-baselines3's SAC with the same update written out by hand: no autograd, one gather, fused Adam."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import SAC as StableBaselinesSAC
from torch import Tensor, nn
from torch.optim.adam import adam

from algorithms.packed_replay import PackedReplayBuffer
from algorithms.perceptron import (
    ACTOR,
    FIRST,
    SECOND,
    FlatModule,
    Layer,
    Workspace,
    linear_layers,
    processor_rounds,
    through_relu,
)

LOG_STD_MIN: Final = -20.0
LOG_STD_MAX: Final = 2.0
SQUASH_EPSILON: Final = 1e-6
"""stable-baselines3's constants of the squashed Gaussian."""
HALF_LOG_TWO_PI: Final = 0.5 * math.log(2.0 * math.pi)
_MADE_BY_SETUP: Final = (
    "_flat_actor", "_online", "_slow", "_space", "_trunk", "_mean", "_log_std", "_critics", "_targets",
)  # fmt: skip


def adam_step(optimizer: torch.optim.Optimizer) -> None:
    """One step of an optimiser with a single parameter: the kernel of `Adam.step` without what surrounds it."""
    group = optimizer.param_groups[0]
    (parameter,) = group["params"]
    state = optimizer.state[parameter]
    if not state:
        state["step"] = torch.zeros(())
        state["exp_avg"], state["exp_avg_sq"] = torch.zeros_like(parameter), torch.zeros_like(parameter)
    beta1, beta2 = group["betas"]
    adam(
        [parameter], [parameter.grad], [state["exp_avg"]], [state["exp_avg_sq"]], [], [state["step"]],
        fused=True, amsgrad=False, beta1=beta1, beta2=beta2, lr=group["lr"], weight_decay=0.0, eps=group["eps"],
        maximize=False,
    )  # fmt: skip


@contextmanager
def denormals_are_zero() -> Iterator[None]:
    """Count numbers below 1.2e-38 as 0 within, on this thread.

    Two fifths of the gradients soon are exactly 0, behind ReLUs that never open. Adam's first moment of such a weight
    shrinks to the smallest denormal number and stays there, as 0.9 times that rounds to itself; it moves no weight, so
    that weights stay the same, bit for bit, but processors take over a hundred cycles for each such product: two fifths
    of all time (docs/performance.md).
    """
    before = float(torch.full((1,), 1e-40) * 1.0) == 0.0
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(before)


class FastSAC(StableBaselinesSAC):
    """The stock learner's interface and update, faster.

    `train` computes what `stable_baselines3.SAC.train` computes (a test holds both to each other): temperature,
    twin critics, actor, targets, in that order, from the same random numbers. What is saved: autograd's
    bookkeeping, critic weight gradients in the actor's step, a second pass through the actor.

    Raises:
        ValueError: An argument asks for something else than that update.
    """

    rounded = False
    """Whether products of wide layers round their factors to bfloat16."""

    def _setup_model(self) -> None:
        self._refuse_other_updates()
        self.replay_buffer_class = PackedReplayBuffer
        super()._setup_model()
        modules = (self.actor, self.critic, self.critic_target)
        self._flat_actor, self._online, self._slow = (FlatModule(module) for module in modules)
        for module, flat in ((self.actor, self._flat_actor), (self.critic, self._online)):
            group = module.optimizer.param_groups[0]
            module.optimizer = torch.optim.Adam([flat.vector], lr=group["lr"], fused=True)
        self._space = Workspace(self.rounded)
        # Mean and log standard deviation are two heads on one trunk.
        self._trunk = linear_layers(self.actor.latent_pi)
        (self._mean,) = linear_layers(cast(nn.Linear, self.actor.mu))
        (self._log_std,) = linear_layers(cast(nn.Linear, self.actor.log_std))
        self._critics = [linear_layers(network) for network in self.critic.q_networks]
        self._targets = [linear_layers(network) for network in self.critic_target.q_networks]

    def _refuse_other_updates(self) -> None:
        """What stable-baselines3 takes and the update below would ignore."""
        shape = self.observation_space.shape if isinstance(self.observation_space, spaces.Box) else None
        networks = {name: value for name, value in self.policy_kwargs.items() if name not in ("net_arch", "use_sde")}
        refused = {
            f"observations of {self.observation_space}": shape is None or len(shape) != 1,
            f"ent_coef={self.ent_coef}": not str(self.ent_coef).startswith("auto"),
            f"target_update_interval={self.target_update_interval}": self.target_update_interval != 1,
            f"n_steps={self.n_steps}": self.n_steps != 1,
            "use_sde": self.use_sde,
            f"replay_buffer_class={self.replay_buffer_class}": (
                self.replay_buffer_class not in (None, PackedReplayBuffer)
            ),
            f"replay_buffer_kwargs={self.replay_buffer_kwargs}": bool(self.replay_buffer_kwargs),
            "optimize_memory_usage": self.optimize_memory_usage,
            f"policy_kwargs {networks}": bool(networks),
            "a VecNormalize environment": self._vec_normalize_env is not None,
        }
        for name, asked in refused.items():
            if asked:
                raise ValueError(f"{type(self).__name__} has no {name}: use stable_baselines3.SAC for that")

    def _excluded_save_params(self) -> list[str]:
        """Views into the policy's parameters, and buffers: `_setup_model` makes them again."""
        return [*super()._excluded_save_params(), *_MADE_BY_SETUP]

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Do so many updates."""
        self.policy.set_training_mode(True)
        for flat in (self._flat_actor, self._online, self._slow):
            flat.gather()
        assert self.ent_coef_optimizer is not None
        self._update_learning_rate([self.actor.optimizer, self.critic.optimizer, self.ent_coef_optimizer])
        sums = np.zeros(3)
        with torch.no_grad(), denormals_are_zero():
            for _ in range(gradient_steps):
                sums += self._update(batch_size)
        self._n_updates += gradient_steps
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        for key, value in zip(("ent_coef", "actor_loss", "critic_loss"), sums / gradient_steps, strict=True):
            self.logger.record(f"train/{key}", value)

    def _update(self, batch_size: int) -> tuple[float, float, float]:
        """One update; temperature, actor loss and critic loss."""
        assert isinstance(self.replay_buffer, PackedReplayBuffer)
        rows = self.replay_buffer.sample_rows(batch_size)
        n, a = self.observation_space.shape[0], self.action_space.shape[0]  # type: ignore[index]
        states, next_states = rows[:, :n], rows[:, n + a + 2 :]
        reward, terminated = rows[:, n + a], rows[:, n + a + 1]
        noise = torch.cat([torch.randn(batch_size, a) for _ in range(2)])
        both = self._sample_actions(torch.cat([states, next_states]), noise)
        sample = both.first(batch_size)
        next_actions, next_log_prob = both.action[batch_size:], both.log_prob[batch_size:]
        alpha = self._update_temperature(sample.log_prob)
        value = self._least_value(self._targets, torch.cat([next_states, next_actions], 1))
        target = reward + (1.0 - terminated) * self.gamma * (value - alpha * next_log_prob)
        critic_loss = self._update_critics(rows[:, : n + a].contiguous(), target)
        actor_loss = self._update_actor(states, sample, alpha)
        self._slow.vector.data.lerp_(self._online.vector.data, self.tau)
        return alpha, actor_loss, critic_loss

    def _least_value(self, critics: list[list[Layer]], state_action: Tensor) -> Tensor:
        """The smaller of both critics' values, shape (batch,)."""
        return torch.minimum(*(self._space.forward(critic, state_action, FIRST)[-1] for critic in critics))[:, 0]

    def _sample_actions(self, states: Tensor, noise: Tensor) -> _Sample:
        """Squashed Gaussian actions of the actor, their log-probabilities, and what their gradients need."""
        # The trunk ends in a ReLU of its own.
        activations = self._space.forward([*self._trunk, self._mean], states, ACTOR)
        hidden, mean = activations[-2], activations[-1]
        raw = torch.addmm(self._log_std.bias, hidden, self._log_std.transposed)
        log_std = raw.clamp(LOG_STD_MIN, LOG_STD_MAX)
        std = log_std.exp()
        action = torch.tanh(mean + std * noise)
        slope = 1.0 - action * action
        log_prob = (-0.5 * noise * noise - log_std - HALF_LOG_TWO_PI - (slope + SQUASH_EPSILON).log()).sum(1)
        return _Sample(activations[:-1], action, slope, noise, std, raw, log_prob)

    def _update_temperature(self, log_prob: Tensor) -> float:
        """Temperature before this step's update, which follows."""
        assert self.log_ent_coef is not None
        assert self.ent_coef_optimizer is not None
        alpha = float(self.log_ent_coef.exp())
        self.log_ent_coef.grad = -(log_prob + float(self.target_entropy)).mean().reshape(1)
        adam_step(self.ent_coef_optimizer)
        return alpha

    def _update_critics(self, state_action: Tensor, target: Tensor) -> float:
        """Half the sum of both critics' mean squared errors."""
        loss = 0.0
        for critic in self._critics:
            activations = self._space.forward(critic, state_action, FIRST)
            error = activations[-1][:, 0] - target
            loss += 0.5 * float(error.square().mean())
            self._space.backward(critic, activations, (error / len(error))[:, None], weights=True, inputs=0)
        adam_step(self.critic.optimizer)
        return loss

    def _update_actor(self, states: Tensor, sample: _Sample, alpha: float) -> float:
        """Mean of alpha log pi - min Q."""
        batch, action = len(states), sample.action
        state_action = torch.cat([states, action], 1)
        passes = [
            self._space.forward(critic, state_action, holder)
            for critic, holder in zip(self._critics, (FIRST, SECOND), strict=True)
        ]
        first = passes[0][-1] <= passes[1][-1]
        value = torch.where(first, passes[0][-1], passes[1][-1])[:, 0]
        gradient = torch.zeros_like(action)
        for critic, hidden, chosen in zip(self._critics, passes, (first, ~first), strict=True):
            weight = chosen.to(action.dtype) * (-1.0 / batch)
            through = self._space.backward(critic, hidden, weight, weights=False, inputs=action.shape[1])
            assert through is not None
            gradient += through
        # d log pi / d action = 2 a / (1 - a^2 + eps); action = tanh(mean + std * noise).
        gradient += (2.0 * alpha / batch) * action / (sample.slope + SQUASH_EPSILON)
        to_mean = gradient * sample.slope
        to_log_std = to_mean * sample.std * sample.noise - alpha / batch
        to_log_std *= (sample.raw_log_std >= LOG_STD_MIN) & (sample.raw_log_std <= LOG_STD_MAX)
        self._backward_actor(sample.activations, to_mean, to_log_std)
        adam_step(self.actor.optimizer)
        return float((alpha * sample.log_prob - value).mean())

    def _backward_actor(self, activations: list[Tensor], to_mean: Tensor, to_log_std: Tensor) -> None:
        """Write the actor's gradients from those of its two heads."""
        hidden = activations[-1]
        for head, incoming in ((self._mean, to_mean), (self._log_std, to_log_std)):
            self._space.write_gradient(head, incoming, hidden)
        gradient = torch.mm(to_mean, self._mean.weight).addmm_(to_log_std, self._log_std.weight)
        self._space.backward(self._trunk, activations[:-1], through_relu(gradient, hidden), weights=True, inputs=0)


class HalfFastSAC(FastSAC):
    """`FastSAC` with products in bfloat16: pays where the processor has matrix units for it (AMX).

    Raises:
        ValueError: The processor has no such products.
    """

    rounded = True

    def _setup_model(self) -> None:
        if not processor_rounds():
            raise ValueError("sac.learner=bf16: no products in bfloat16 on this processor; leave it at fast")
        super()._setup_model()


@dataclass(slots=True)
class _Sample:
    """Actions with all that their gradients need, each of shape (batch, actions), log_prob (batch,).

    The activations of the actor's trunk are those of the last sample only.
    """

    activations: list[Tensor]
    action: Tensor
    slope: Tensor
    noise: Tensor
    std: Tensor
    raw_log_std: Tensor
    log_prob: Tensor

    def first(self, rows: int) -> _Sample:
        """The first rows."""
        rest = (self.action, self.slope, self.noise, self.std, self.raw_log_std, self.log_prob)
        return _Sample([layer[:rows] for layer in self.activations], *(tensor[:rows] for tensor in rest))


@contextmanager
def reproducible(seed: int) -> Iterator[None]:
    """Run a stable-baselines3 learner without leaving traces in the global generators.

    Python's is among them: stable-baselines3 seeds it though it never draws from it.
    """
    python_state, numpy_state, torch_state = random.getstate(), np.random.get_state(), torch.get_rng_state()  # noqa: NPY002
    torch.manual_seed(seed)
    np.random.seed(seed % 2**32)  # noqa: NPY002
    try:
        yield
    finally:
        random.setstate(python_state)
        np.random.set_state(numpy_state)  # noqa: NPY002
        torch.set_rng_state(torch_state)

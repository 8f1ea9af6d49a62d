"""stable-baselines3's SAC with the same update written out by hand: no autograd, one gather, fused Adam."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, cast

import numpy as np
import torch
from stable_baselines3 import SAC as StableBaselinesSAC
from torch import nn

from algorithms import sac_kernels
from algorithms.fast_sac_checks import checked_replay, refuse_other_networks, refuse_other_updates
from algorithms.minibatch import Minibatch
from algorithms.packed_replay import PackedReplayBuffer
from algorithms.perceptron import (
    ACTOR,
    FIRST,
    SECOND,
    FlatModule,
    Shared,
    Workspace,
    linear_layers,
    processor_rounds,
    shared,
)
from algorithms.sac_kernels import LOG_STD_MAX, LOG_STD_MIN, Single

_MADE_BY_SETUP: Final = (
    "_flat_actor", "_online", "_slow", "_space", "_trunk", "_mean", "_log_std", "_critics", "_targets",
    "_minibatches",
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
    state["step"] += 1
    torch.ops.aten._fused_adam_.default(
        [parameter], [parameter.grad], [state["exp_avg"]], [state["exp_avg_sq"]], [], [state["step"]],
        amsgrad=False, beta1=beta1, beta2=beta2, lr=group["lr"], weight_decay=0.0, eps=group["eps"], maximize=False,
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

    `train` computes what `stable_baselines3.SAC.train` computes (a test holds both to each other) for temperature,
    twin critics, their targets and the actor, from the same random numbers. What is spared: autograd's
    bookkeeping, critic weight gradients in the actor's step, a second pass through the actor. Files are its own: an
    optimiser has one long parameter, so that neither learner loads what the other saved.

    Raises:
        ValueError: An argument asks for something else than that update.
    """

    rounded = False
    """Whether products of wide layers round their factors to bfloat16."""

    def _setup_model(self) -> None:
        refuse_other_updates(self)
        self.replay_buffer_class = PackedReplayBuffer
        super()._setup_model()
        modules = (self.actor, self.critic, self.critic_target)
        refuse_other_networks(self)
        self._flat_actor, self._online, self._slow = (FlatModule(module) for module in modules)
        for module, flat in ((self.actor, self._flat_actor), (self.critic, self._online)):
            group = module.optimizer.param_groups[0]
            module.optimizer = torch.optim.Adam([flat.vector], lr=group["lr"], fused=True)
        self._space = Workspace(self.rounded)
        self._minibatches: dict[int, Minibatch] = {}
        # Mean and log standard deviation are two heads on one trunk.
        self._trunk = linear_layers(self.actor.latent_pi)
        (self._mean,) = linear_layers(cast(nn.Linear, self.actor.mu))
        (self._log_std,) = linear_layers(cast(nn.Linear, self.actor.log_std))
        self._critics = [linear_layers(network) for network in self.critic.q_networks]
        self._targets = [linear_layers(network) for network in self.critic_target.q_networks]

    def _excluded_save_params(self) -> list[str]:
        """Views into the policy's parameters, and buffers: `_setup_model` makes them again."""
        return [*super()._excluded_save_params(), *_MADE_BY_SETUP]

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Do so many updates."""
        self.policy.set_training_mode(True)
        for flat in (self._flat_actor, self._online, self._slow):
            flat.gather()
        assert self.ent_coef_optimizer is not None
        replay = checked_replay(self)
        self._update_learning_rate([self.actor.optimizer, self.critic.optimizer, self.ent_coef_optimizer])
        batch = self._minibatch(batch_size)
        # All that is random is drawn first: between updates, which empty the caches, a draw takes far longer.
        chosen = [replay.draw(batch_size) for _ in range(gradient_steps)]
        noise = shared(gradient_steps, 2 * batch_size, batch.actions)
        for half in noise.tensor.view(2 * gradient_steps, -1):
            half.normal_()
        losses = shared(gradient_steps, 3, batch_size)  # the actor's and both critics': their means can wait, too
        temperatures = np.zeros((gradient_steps, 2))
        with torch.no_grad(), denormals_are_zero():
            for update in range(gradient_steps):
                batch.take(replay.transitions, chosen[update], noise.array[update])
                temperatures[update] = self._update(batch, losses.array[update])
        actor, first, second = losses.tensor.mean(2).double().t()
        self._n_updates += gradient_steps
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        alphas, alpha_losses = temperatures.T.tolist()
        reported = {"ent_coef": alphas, "ent_coef_loss": alpha_losses, "actor_loss": actor.tolist(),
                    "critic_loss": (0.5 * first + 0.5 * second).tolist()}  # fmt: skip
        for key, values in reported.items():
            self.logger.record(f"train/{key}", sum(values) / gradient_steps)

    def _minibatch(self, size: int) -> Minibatch:
        if size not in self._minibatches:
            self._minibatches[size] = Minibatch(size, self.observation_space.shape[0], self.action_space.shape[0])  # type: ignore[index]
        return self._minibatches[size]

    def _update(self, batch: Minibatch, losses: Single) -> tuple[float, float]:
        """One update; the temperature before it and its loss. Terms of the others: actor, critics, shape (3, batch)."""
        hidden = self._sample_actions(batch)
        alpha, alpha_loss = self._update_temperature(batch)
        self._update_critics(batch, alpha, losses[1:])
        self._slow.vector.data.lerp_(self._online.vector.data, self.tau)
        self._update_actor(batch, hidden, alpha, losses[0])
        return alpha, alpha_loss

    def _sample_actions(self, batch: Minibatch) -> list[Shared]:
        """Squashed Gaussian actions and their log-probabilities; input and hidden layers of the actor's trunk."""
        # The trunk ends in a ReLU of its own.
        hidden = self._space.forward([*self._trunk, self._mean], batch.states, ACTOR, batch.mean)[:-1]
        self._log_std.apply(hidden[-1], batch.raw_log_std)
        torch.clamp(batch.raw_log_std.tensor, float(LOG_STD_MIN), float(LOG_STD_MAX), out=batch.log_std.tensor)
        torch.exp(batch.log_std.tensor, out=batch.std.tensor)
        sac_kernels.add_noise(batch.mean.array, batch.std.array, batch.noise, batch.action.array)
        batch.action.tensor.tanh_()
        sac_kernels.slope_of_tanh(batch.action.array, batch.slope.array, batch.log_slope.array)
        batch.log_slope.tensor.log_()
        sac_kernels.log_probability(
            batch.noise, batch.log_std.array, batch.log_slope.array, batch.action.array,
            batch.log_prob.array, batch.policy_action.array, batch.next_action.array,
        )  # fmt: skip
        return hidden

    def _update_temperature(self, batch: Minibatch) -> tuple[float, float]:
        """One step of the temperature; what it was, and its loss."""
        assert self.log_ent_coef is not None
        assert self.ent_coef_optimizer is not None
        alpha = float(self.log_ent_coef.exp())
        log_prob = batch.log_prob.tensor[: batch.size]
        gradient = -(log_prob + float(self.target_entropy)).mean().reshape(1)
        loss = float(self.log_ent_coef * gradient)
        self.log_ent_coef.grad = gradient
        adam_step(self.ent_coef_optimizer)
        return alpha, loss

    def _update_critics(self, batch: Minibatch, alpha: float, losses: Single) -> None:
        """One step of both critics; terms of their mean squared errors go to `losses`, shape (2, batch)."""
        for target, value in zip(self._targets, batch.values, strict=True):
            self._space.forward(target, batch.next_action, FIRST, value)
        first, second = (value.array for value in batch.values)
        sac_kernels.bellman_target(
            batch.reward.array, batch.goes_on.array, np.float32(self.gamma), first, second, np.float32(alpha),
            batch.log_prob.array, batch.target.array,
        )  # fmt: skip
        for critic, value, slope, loss in zip(self._critics, batch.values, batch.slopes, losses, strict=True):
            activations = self._space.forward(critic, batch.state_action, FIRST, value)
            sac_kernels.squared_error(value.array, batch.target.array, loss, slope.array)
            self._space.write_gradients(critic, activations, slope)
        adam_step(self.critic.optimizer)

    def _update_actor(self, batch: Minibatch, hidden: list[Shared], alpha: float, loss: Single) -> None:
        """One step of the actor; alpha log pi - min Q goes to `loss`, shape (batch,)."""
        passes = [
            self._space.forward(critic, batch.policy_action, holder, value)
            for critic, holder, value in zip(self._critics, (FIRST, SECOND), batch.values, strict=True)
        ]
        first, second = batch.values
        to_first, to_second = batch.slopes
        sac_kernels.least_value(
            first.array, second.array, np.float32(alpha), batch.log_prob.array, to_first.array, to_second.array, loss
        )
        for critic, activations, slope, through in zip(self._critics, passes, batch.slopes, batch.through, strict=True):
            self._space.gradient_of_inputs(critic, activations, slope, batch.actions, through)
        through_first, through_second = batch.through
        sac_kernels.through_action(
            through_first.array, through_second.array, np.float32(alpha / batch.size), batch.action.array,
            batch.slope.array, batch.std.array, batch.noise, batch.raw_log_std.array, batch.to_mean.array,
            batch.to_log_std.array,
        )  # fmt: skip
        self._backward_actor([layer.first(batch.size) for layer in hidden], batch.to_mean, batch.to_log_std)
        adam_step(self.actor.optimizer)

    def _backward_actor(self, hidden: list[Shared], to_mean: Shared, to_log_std: Shared) -> None:
        """Write the actor's gradients from those of its two heads."""
        last = hidden[-1]
        for head, incoming in ((self._mean, to_mean), (self._log_std, to_log_std)):
            self._space.write_gradients([head], [last], incoming)
        through = torch.mm(to_mean.tensor, self._mean.weight).addmm_(to_log_std.tensor, self._log_std.weight)
        gradient = Shared.of(through)
        self._space.through_relu(gradient, last, self._trunk[-1])
        self._space.write_inner_gradients(self._trunk, hidden[:-1], gradient)


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

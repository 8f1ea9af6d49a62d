"""stable-baselines3's SAC with the same update written out by hand: no autograd, one gather, fused Adam."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np
import torch
from stable_baselines3 import SAC as StableBaselinesSAC
from stable_baselines3.common.buffers import ReplayBuffer
from torch import Tensor, nn

LOG_STD_MIN: Final = -20.0
LOG_STD_MAX: Final = 2.0
SQUASH_EPSILON: Final = 1e-6
"""stable-baselines3's constants of the squashed Gaussian."""
HALF_LOG_TWO_PI: Final = 0.5 * math.log(2.0 * math.pi)


class PackedReplayBuffer(ReplayBuffer):
    """stable-baselines3's replay buffer with a transition in one row, so that a batch is one gather.

    Row: observation, action, reward, whether it terminated (time-outs do not count), next observation.
    The same generator calls in the same order as the original: the same seed samples the same transitions.
    """

    def __init__(self, buffer_size: int, *args: Any, **kwargs: Any) -> None:
        """Allocate the rows; the original's five arrays stay empty."""
        super().__init__(1, *args, **kwargs)
        self.buffer_size = max(buffer_size // self.n_envs, 1)
        self._size = int(self.obs_shape[0])
        width = 2 * self._size + self.action_dim + 2
        self.rows = np.zeros((self.buffer_size, self.n_envs, width), np.float32)

    def add(
        self, obs: np.ndarray, next_obs: np.ndarray, action: np.ndarray, reward: np.ndarray,
        done: np.ndarray, infos: list[dict[str, Any]],
    ) -> None:  # fmt: skip
        """Store one transition of every world."""
        n, a = self._size, self.action_dim
        timeout = np.array([info.get("TimeLimit.truncated", False) for info in infos])
        row = self.rows[self.pos]
        row[:, :n] = obs
        row[:, n : n + a] = action.reshape(self.n_envs, a)
        row[:, n + a] = reward
        row[:, n + a + 1] = done & ~timeout
        row[:, n + a + 2 :] = next_obs
        self.pos += 1
        if self.pos == self.buffer_size:
            self.full = True
            self.pos = 0

    def sample_rows(self, batch_size: int) -> Tensor:
        """Uniformly drawn transitions, shape (batch, row)."""
        upper = self.buffer_size if self.full else self.pos
        times = np.random.randint(0, upper, size=batch_size)  # noqa: NPY002  the original's generator
        worlds = np.random.randint(0, high=self.n_envs, size=(batch_size,))  # noqa: NPY002
        flat = self.rows.reshape(-1, self.rows.shape[-1])
        return torch.from_numpy(flat.take(times * self.n_envs + worlds, axis=0))


def linear_layers(module: nn.Module) -> list[nn.Linear]:
    """Linear layers of a module, in order."""
    return [child for child in module.modules() if isinstance(child, nn.Linear)]


ACTOR, FIRST, SECOND, GRADIENT = range(4)
"""Who holds a buffer of a `Workspace`: hidden layers of the actor, of a critic, of the other one, or gradients."""


class Workspace:
    """Buffers for passes through ReLU perceptrons: products are written where the cache still holds the memory."""

    def __init__(self) -> None:
        self._buffers: dict[tuple[int, ...], Tensor] = {}

    def buffer(self, holder: int, index: int, rows: int, width: int) -> Tensor:
        """The buffer of a holder's layer, shape (rows, width), with whatever was written to it last."""
        key = (holder, index, rows, width)
        if key not in self._buffers:
            self._buffers[key] = torch.empty(rows, width)
        return self._buffers[key]

    def forward(self, layers: list[nn.Linear], x: Tensor, holder: int) -> list[Tensor]:
        """Activations of a perceptron: input, hidden layers after ReLU, linear output.

        The holder's next pass overwrites the hidden layers.
        """
        activations = [x]
        for index, layer in enumerate(layers[:-1]):
            out = self.buffer(holder, index, len(x), layer.out_features)
            torch.addmm(layer.bias, activations[-1], layer.weight.t(), out=out)
            activations.append(out.relu_())
        activations.append(torch.addmm(layers[-1].bias, activations[-1], layers[-1].weight.t()))
        return activations

    def backward(
        self, layers: list[nn.Linear], activations: list[Tensor], gradient: Tensor, weights: bool, inputs: bool
    ) -> Tensor | None:
        """Propagate the gradient of the output; write ``.grad`` of the weights, return that of the input, if wanted."""
        for index in range(len(layers) - 1, -1, -1):
            layer, before = layers[index], activations[index]
            if weights:
                write_gradient(layer, gradient, before)
            if index == 0:
                return torch.mm(gradient, layer.weight) if inputs else None
            out = self.buffer(GRADIENT, index % 2, len(before), layer.in_features)
            gradient = through_relu(torch.mm(gradient, layer.weight, out=out), before)
        return None


def through_relu(gradient: Tensor, output: Tensor) -> Tensor:
    """The gradient, in place, where the output of the ReLU is positive; else 0."""
    torch.ops.aten.threshold_backward.grad_input(gradient, output, 0.0, grad_input=gradient)
    return gradient


def write_gradient(layer: nn.Linear, gradient: Tensor, before: Tensor) -> None:
    """Gradients of a layer's weight and bias from that of its output and from its input."""
    assert layer.weight.grad is not None
    assert layer.bias.grad is not None
    torch.mm(gradient.t(), before, out=layer.weight.grad)
    torch.sum(gradient, 0, out=layer.bias.grad)


def flatten(module: nn.Module) -> nn.Parameter:
    """One parameter that holds all of a module's, values and gradients: the module keeps views into it.

    Adam works element by element; over one long vector it has no per-parameter work.
    """
    parameters = list(module.parameters())
    flat = nn.Parameter(torch.cat([parameter.detach().reshape(-1) for parameter in parameters]))
    flat.grad = torch.zeros_like(flat)
    sizes = [parameter.numel() for parameter in parameters]
    for parameter, value, gradient in zip(parameters, flat.data.split(sizes), flat.grad.split(sizes), strict=True):
        parameter.data = value.view_as(parameter)
        parameter.grad = gradient.view_as(parameter)
    return flat


class FastSAC(StableBaselinesSAC):
    """The stock learner's interface and update, faster.

    `train` computes what `stable_baselines3.SAC.train` computes (a test holds both to each other): temperature,
    twin critics, actor, targets, in that order, from the same random numbers. What is saved: autograd's
    bookkeeping, critic weight gradients in the actor's step, a second pass through the actor.
    """

    def _setup_model(self) -> None:
        self.replay_buffer_class = PackedReplayBuffer
        super()._setup_model()
        flat_actor, self._online, self._slow = map(flatten, (self.actor, self.critic, self.critic_target))
        for module, flat in ((self.actor, flat_actor), (self.critic, self._online)):
            group = module.optimizer.param_groups[0]
            module.optimizer = torch.optim.Adam([flat], lr=group["lr"], fused=True)
        self._space = Workspace()
        # Mean and log standard deviation are two heads on one trunk.
        self._trunk = linear_layers(self.actor.latent_pi)
        self._mean, self._log_std = cast(nn.Linear, self.actor.mu), cast(nn.Linear, self.actor.log_std)
        self._critics = [linear_layers(network) for network in self.critic.q_networks]
        self._targets = [linear_layers(network) for network in self.critic_target.q_networks]

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Do so many updates."""
        self.policy.set_training_mode(True)
        assert self.ent_coef_optimizer is not None
        self._update_learning_rate([self.actor.optimizer, self.critic.optimizer, self.ent_coef_optimizer])
        sums = np.zeros(3)
        with torch.no_grad():
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
        states, next_states = rows[:, :n].contiguous(), rows[:, n + a + 2 :].contiguous()
        state_action, reward, terminated = rows[:, : n + a].contiguous(), rows[:, n + a], rows[:, n + a + 1]
        noise, next_noise = (torch.normal(torch.zeros(batch_size, a), torch.ones(batch_size, a)) for _ in range(2))
        following = self._sample_actions(next_states, next_noise)
        sample = self._sample_actions(states, noise)
        alpha = self._update_temperature(sample.log_prob)
        value = self._least_value(self._targets, torch.cat([next_states, following.action], 1))
        target = reward + (1.0 - terminated) * self.gamma * (value - alpha * following.log_prob)
        critic_loss = self._update_critics(state_action, target)
        actor_loss = self._update_actor(states, sample, alpha)
        self._slow.data.lerp_(self._online.data, self.tau)
        return alpha, actor_loss, critic_loss

    def _least_value(self, critics: list[list[nn.Linear]], state_action: Tensor) -> Tensor:
        """The smaller of both critics' values, shape (batch,)."""
        return torch.minimum(*(self._space.forward(critic, state_action, FIRST)[-1] for critic in critics))[:, 0]

    def _sample_actions(self, states: Tensor, noise: Tensor) -> _Sample:
        """Squashed Gaussian actions of the actor, their log-probabilities, and what their gradients need."""
        # The trunk ends in a ReLU of its own.
        activations = self._space.forward([*self._trunk, self._mean], states, ACTOR)
        hidden, mean = activations[-2], activations[-1]
        raw = torch.addmm(self._log_std.bias, hidden, self._log_std.weight.t())
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
        self.ent_coef_optimizer.step()
        return alpha

    def _update_critics(self, state_action: Tensor, target: Tensor) -> float:
        """Half the sum of both critics' mean squared errors."""
        loss = 0.0
        for critic in self._critics:
            activations = self._space.forward(critic, state_action, FIRST)
            error = activations[-1][:, 0] - target
            loss += 0.5 * float(error.square().mean())
            self._space.backward(critic, activations, (error / len(error))[:, None], weights=True, inputs=False)
        self.critic.optimizer.step()
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
            through = self._space.backward(critic, hidden, weight, weights=False, inputs=True)
            assert through is not None
            gradient += through[:, states.shape[1] :]
        # d log pi / d action = 2 a / (1 - a^2 + eps); action = tanh(mean + std * noise).
        gradient += (2.0 * alpha / batch) * action / (sample.slope + SQUASH_EPSILON)
        to_mean = gradient * sample.slope
        to_log_std = to_mean * sample.std * sample.noise - alpha / batch
        to_log_std *= (sample.raw_log_std >= LOG_STD_MIN) & (sample.raw_log_std <= LOG_STD_MAX)
        self._backward_actor(sample.activations, to_mean, to_log_std)
        self.actor.optimizer.step()
        return float((alpha * sample.log_prob - value).mean())

    def _backward_actor(self, activations: list[Tensor], to_mean: Tensor, to_log_std: Tensor) -> None:
        """Write the actor's gradients from those of its two heads."""
        hidden = activations[-1]
        for head, incoming in ((self._mean, to_mean), (self._log_std, to_log_std)):
            write_gradient(head, incoming, hidden)
        gradient = torch.mm(to_mean, self._mean.weight).addmm_(to_log_std, self._log_std.weight)
        self._space.backward(self._trunk, activations[:-1], through_relu(gradient, hidden), weights=True, inputs=False)


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


@contextmanager
def reproducible(seed: int) -> Iterator[None]:
    """Run a stable-baselines3 learner without leaving traces in the global generators."""
    numpy_state, torch_state = np.random.get_state(), torch.get_rng_state()  # noqa: NPY002
    torch.manual_seed(seed)
    np.random.seed(seed % 2**32)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(numpy_state)  # noqa: NPY002
        torch.set_rng_state(torch_state)

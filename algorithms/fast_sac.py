"""stable-baselines3's SAC with the same update written out by hand: no autograd, one gather, fused Adam."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
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


def forward(layers: list[nn.Linear], x: Tensor) -> list[Tensor]:
    """Activations of a ReLU perceptron: input, hidden layers after ReLU, linear output."""
    activations = [x]
    for layer in layers[:-1]:
        activations.append(torch.addmm(layer.bias, activations[-1], layer.weight.t()).relu_())
    activations.append(torch.addmm(layers[-1].bias, activations[-1], layers[-1].weight.t()))
    return activations


def backward(
    layers: list[nn.Linear], activations: list[Tensor], gradient: Tensor, weights: bool, inputs: bool
) -> Tensor | None:
    """Propagate the gradient of the output; write ``.grad`` of the weights, return that of the input, if wanted."""
    for index in range(len(layers) - 1, -1, -1):
        layer, before = layers[index], activations[index]
        if weights:
            assert layer.weight.grad is not None
            assert layer.bias.grad is not None
            torch.mm(gradient.t(), before, out=layer.weight.grad)
            torch.sum(gradient, 0, out=layer.bias.grad)
        if index == 0 and not inputs:
            return None
        gradient = torch.mm(gradient, layer.weight)
        if index > 0:
            gradient = torch.ops.aten.threshold_backward(gradient, before, 0.0)
    return gradient


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
        state_action, reward, terminated = rows[:, : n + a], rows[:, n + a], rows[:, n + a + 1]
        both = torch.cat([rows[:, :n], rows[:, n + a + 2 :]])
        activations = forward(self._trunk, both)
        sample = self._sample_actions(activations, batch_size)
        alpha = self._update_temperature(sample.log_prob[:batch_size])
        following = torch.cat([both[batch_size:], sample.action[batch_size:]], 1)
        value = torch.minimum(*(forward(target, following)[-1] for target in self._targets))[:, 0]
        target = reward + (1.0 - terminated) * self.gamma * (value - alpha * sample.log_prob[batch_size:])
        critic_loss = self._update_critics(state_action, target)
        actor_loss = self._update_actor(both[:batch_size], activations, sample, alpha)
        self._slow.data.lerp_(self._online.data, self.tau)
        return alpha, actor_loss, critic_loss

    def _sample_actions(self, activations: list[Tensor], batch_size: int) -> _Sample:
        """Squashed Gaussian actions of the actor and their log-probabilities, for states then next states."""
        # The trunk ends in a ReLU of its own.
        hidden = activations[-1].relu_()
        mean = torch.addmm(self._mean.bias, hidden, self._mean.weight.t())
        raw = torch.addmm(self._log_std.bias, hidden, self._log_std.weight.t())
        log_std = raw.clamp(LOG_STD_MIN, LOG_STD_MAX)
        zeros, ones = torch.zeros_like(mean[:batch_size]), torch.ones_like(mean[:batch_size])
        noise = torch.cat([torch.normal(zeros, ones), torch.normal(zeros, ones)])
        std = log_std.exp()
        action = torch.tanh(mean + std * noise)
        slope = 1.0 - action * action
        log_prob = (-0.5 * noise * noise - log_std - HALF_LOG_TWO_PI - (slope + SQUASH_EPSILON).log()).sum(1)
        return _Sample(action, slope, noise, std, raw, log_prob)

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
            activations = forward(critic, state_action)
            error = activations[-1][:, 0] - target
            loss += 0.5 * float(error.square().mean())
            backward(critic, activations, (error / len(error))[:, None], weights=True, inputs=False)
        self.critic.optimizer.step()
        return loss

    def _update_actor(self, states: Tensor, activations: list[Tensor], sample: _Sample, alpha: float) -> float:
        """Mean of alpha log pi - min Q."""
        batch = len(states)
        action, slope, noise = sample.action[:batch], sample.slope[:batch], sample.noise[:batch]
        state_action = torch.cat([states, action], 1)
        passes = [forward(critic, state_action) for critic in self._critics]
        first = passes[0][-1] <= passes[1][-1]
        value = torch.where(first, passes[0][-1], passes[1][-1])[:, 0]
        gradient = torch.zeros_like(action)
        for critic, hidden, chosen in zip(self._critics, passes, (first, ~first), strict=True):
            weight = chosen.to(action.dtype) * (-1.0 / batch)
            through = backward(critic, hidden, weight, weights=False, inputs=True)
            assert through is not None
            gradient += through[:, states.shape[1] :]
        # d log pi / d action = 2 a / (1 - a^2 + eps); action = tanh(mean + std * noise).
        gradient += (2.0 * alpha / batch) * action / (slope + SQUASH_EPSILON)
        to_mean = gradient * slope
        to_log_std = to_mean * sample.std[:batch] * noise - alpha / batch
        raw = sample.raw_log_std[:batch]
        to_log_std *= (raw >= LOG_STD_MIN) & (raw <= LOG_STD_MAX)
        self._backward_actor(activations, to_mean, to_log_std)
        self.actor.optimizer.step()
        return float((alpha * sample.log_prob[:batch] - value).mean())

    def _backward_actor(self, activations: list[Tensor], to_mean: Tensor, to_log_std: Tensor) -> None:
        batch = len(to_mean)
        hidden = activations[-1][:batch]
        gradient = torch.zeros_like(hidden)
        for head, incoming in ((self._mean, to_mean), (self._log_std, to_log_std)):
            assert head.weight.grad is not None
            assert head.bias.grad is not None
            torch.mm(incoming.t(), hidden, out=head.weight.grad)
            torch.sum(incoming, 0, out=head.bias.grad)
            gradient += torch.mm(incoming, head.weight)
        gradient = torch.ops.aten.threshold_backward(gradient, hidden, 0.0)
        backward(self._trunk, [a[:batch] for a in activations], gradient, weights=True, inputs=False)


class _Sample:
    """Actions with all that their gradients need, each of shape (2 batch, actions), log_prob (2 batch,)."""

    __slots__ = ("action", "log_prob", "noise", "raw_log_std", "slope", "std")

    def __init__(
        self, action: Tensor, slope: Tensor, noise: Tensor, std: Tensor, raw_log_std: Tensor, log_prob: Tensor
    ) -> None:
        self.action = action
        self.slope = slope
        self.noise = noise
        self.std = std
        self.raw_log_std = raw_log_std
        self.log_prob = log_prob


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

"""stable-baselines3's replay buffer, a transition in one row."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize


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

    @property
    def transitions(self) -> npt.NDArray[np.float32]:
        """All rows, shape (buffer_size x worlds, row)."""
        return self.rows.reshape(-1, self.rows.shape[-1])

    def draw(self, batch_size: int) -> npt.NDArray[np.int64]:
        """Uniformly drawn indices into `transitions`, shape (batch,)."""
        upper = self.buffer_size if self.full else self.pos
        times = np.random.randint(0, upper, size=batch_size)  # noqa: NPY002  the original's generator
        worlds = np.random.randint(0, high=self.n_envs, size=(batch_size,))  # noqa: NPY002
        return times * self.n_envs + worlds

    def sample(self, batch_size: int, env: VecNormalize | None = None) -> ReplayBufferSamples:
        """As the original's; what it would normalise is refused.

        Raises:
            ValueError: An environment that normalises.
        """
        if env is not None:
            raise ValueError("PackedReplayBuffer does not normalise: use stable-baselines3's ReplayBuffer for that")
        n, a = self._size, self.action_dim
        rows = torch.from_numpy(self.transitions[self.draw(batch_size)])
        observation, action, reward, done, following = rows.split([n, a, 1, 1, n], dim=1)
        return ReplayBufferSamples(observation, action, following, done, reward)

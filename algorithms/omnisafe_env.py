"""A gymnasium VectorEnv as OmniSafe's CMDP."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar, Final

import numpy as np
import numpy.typing as npt
import torch
from gymnasium.vector import AutoresetMode, VectorEnv

from algorithms.omnisafe_library import omnisafe_module

ENVIRONMENT_ID: Final = "SafeDrive-v0"
"""Name of the environment inside OmniSafe, known there only while a training runs."""

Transition = tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, dict[str, Any]]


class VectorCMDP:
    """N worlds of a `VectorEnv` behind OmniSafe's interface.

    OmniSafe calls `reset` at the start of every epoch. Here only the first call starts episodes; later ones go on
    with those that run. Otherwise the episodes that an epoch cuts would vanish, short crashes would be
    over-counted, and the constraint would be held against a biased episode cost.

    OmniSafe constructs two instances, one of which (for its own evaluation) it never uses.
    """

    need_time_limit_wrapper = False  # would overwrite `truncated`
    need_auto_reset_wrapper = False  # the vector environment resets in the same step
    vector: ClassVar[VectorEnv[Any, Any, Any]]
    epoch_begins: ClassVar[Callable[[], None]]

    def __init__(self, env_id: str, *, num_envs: int = 1, **_unused: Any) -> None:
        """Describe the worlds; episodes begin with the first `reset`."""
        self._env_id = env_id
        self._num_envs = num_envs
        self._observation_space = self.vector.single_observation_space
        self._action_space = self.vector.single_action_space
        self._metadata: dict[str, Any] = {}
        self._observations: npt.NDArray[np.float32] | None = None
        self._sums = np.zeros((2, num_envs))  # return and cost of the running episodes
        self._carried: npt.NDArray[np.float64] | None = None

    def snapshot(self) -> dict[str, npt.NDArray[Any]]:
        """What the next epoch begins with, the vector environment apart."""
        assert self._observations is not None
        return {"observations": self._observations.copy(), "sums": self._sums.copy()}

    def restore(self, kept: Mapping[str, npt.NDArray[Any]]) -> None:
        """Go on from a `snapshot`: the next `reset` begins a later epoch."""
        self._observations, self._sums = kept["observations"].copy(), kept["sums"].copy()

    def set_seed(self, seed: int) -> None:
        """Nothing: the vector environment has random streams of its own."""

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[torch.Tensor, dict[str, Any]]:
        """Begin the first episodes, or, at the start of a later epoch, go on with those that run."""
        if self._observations is None:
            self._observations, _ = self.vector.reset()
        else:
            self._carried = self._sums.copy()
        type(self).epoch_begins()
        return self._tensor(self._observations), {}

    def step(self, action: torch.Tensor) -> Transition:
        """One decision in every world.

        Args:
            action: Physical units, shape (N, A), or (A,) where N is 1; the environment clips it.

        Returns:
            Observation, reward, cost, terminated, truncated, each with leading dimension N unless N is 1, and info:
            ``final_observation`` and its mask where a world finished; ``original_reward`` and ``original_cost``,
            from which OmniSafe sums an episode, with what the episode earned before the epoch began.
        """
        actions = action.detach().numpy().reshape(self._num_envs, -1)
        self._observations, reward, terminated, truncated, info = self.vector.step(actions)
        earned = np.stack([reward, info["cost"]])
        report = {} if self._carried is None else self._original(earned + self._carried)
        self._carried = None
        done = terminated | truncated
        self._sums = np.where(done, 0.0, self._sums + earned)
        if done.any():
            report["final_observation"] = self._tensor(info["final_obs"])
            report["_final_observation"] = self._tensor(done, torch.bool)
        flags = self._tensor(terminated, torch.bool), self._tensor(truncated, torch.bool)
        return self._tensor(self._observations), self._tensor(earned[0]), self._tensor(earned[1]), *flags, report

    def _original(self, earned: npt.NDArray[np.float64]) -> dict[str, Any]:
        return {"original_reward": self._tensor(earned[0]), "original_cost": self._tensor(earned[1])}

    def _tensor(self, values: npt.NDArray[Any], dtype: torch.dtype = torch.float32) -> torch.Tensor:
        """A copy as a tensor, without the leading dimension where N is 1: OmniSafe adds it there."""
        tensor = torch.tensor(values, dtype=dtype)
        return tensor[0] if self._num_envs == 1 else tensor

    def render(self) -> Any:
        """Nothing is drawn."""

    def close(self) -> None:
        """Nothing: the environment's owner closes it."""


@contextlib.contextmanager
def known_to_omnisafe(vector: VectorEnv[Any, Any, Any], epoch_begins: Callable[[], None]) -> Iterator[str]:
    """Make an environment known to OmniSafe for as long as a training runs; gives its id there.

    Args:
        vector: Resets finished worlds in the same step, gives ``cost`` in info and clips its actions.
        epoch_begins: Called at the start of every epoch.

    Raises:
        ValueError: The environment's autoreset mode is another one.
    """
    if vector.metadata.get("autoreset_mode") is not AutoresetMode.SAME_STEP:
        raise ValueError(f"Autoreset mode is {vector.metadata.get('autoreset_mode')}; must be SAME_STEP.")
    core = omnisafe_module("omnisafe.envs.core")
    body = {"vector": vector, "epoch_begins": staticmethod(epoch_begins), "_support_envs": [ENVIRONMENT_ID]}
    cmdp = type("SafeDriveCMDP", (VectorCMDP, core.CMDP), body)
    core.env_register(cmdp)
    try:
        yield ENVIRONMENT_ID
    finally:
        core.env_unregister(cmdp)

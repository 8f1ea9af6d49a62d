"""Our vector environment behind stable-baselines3's `VecEnv` interface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from algorithms.guard_features import GuardFeatures
from algorithms.method import Observations
from envs.driving_env import DrivingVectorEnv


class StableBaselinesEnv(VecEnv):
    """Same-step autoreset, terminal observations and truncation flags as stable-baselines3 expects them."""

    def __init__(self, env: DrivingVectorEnv, features: GuardFeatures | None = None) -> None:
        """Wrap an environment that resets finished worlds by itself; features are appended to its observations."""
        self.render_mode: str | None = None
        space = env.single_observation_space if features is None else features.space
        super().__init__(env.num_envs, space, env.single_action_space)
        self.env = env
        self._features = features
        self._actions: np.ndarray = np.zeros((0, 0))

    def reset(self) -> VecEnvObs:
        """Start a new episode in every world."""
        return self._seen(self.env.reset()[0])

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Carry out the decision."""
        observations, rewards, terminated, truncated, info = self.env.step(self._actions)
        dones = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if dones.any():
            last = self._seen(info["final_obs"])
            for i in np.flatnonzero(dones):
                infos[i] = {"terminal_observation": last[i], "TimeLimit.truncated": bool(truncated[i])}
        return self._seen(observations), rewards.astype(np.float32), dones, infos

    def _seen(self, observations: Observations) -> Observations:
        return observations if self._features is None else self._features(observations)

    def close(self) -> None:
        """Nothing to free."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The same attribute for every world."""
        value = self.render_mode if attr_name == "render_mode" else getattr(self.env, attr_name)
        return [value] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not supported: worlds share their attributes."""
        raise NotImplementedError(f"Cannot set {attr_name!r} of single worlds.")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Not supported: there are no single environments behind the engine."""
        raise NotImplementedError(f"Cannot call {method_name!r} of single worlds.")

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """No world is wrapped."""
        return [False] * len(list(self._get_indices(indices)))

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Ignored: the task's streams seed the episodes, whatever a learner asks for."""
        return [None] * self.num_envs

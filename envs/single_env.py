"""gymnasium's face of one world: `DrivingEnv`."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium
import numpy as np
import numpy.typing as npt

from envs.driving_env import DrivingVectorEnv
from envs.scenario import Scenario


class DrivingEnv(gymnasium.Env[npt.NDArray[np.float32], npt.NDArray[Any]]):
    """One world, the plain gymnasium interface; arguments as in `DrivingVectorEnv`.

    ``info`` of a step: ``cost``, ``reward_without_risk``, ``intervened`` as scalars.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(self, scenario: Scenario | str = "a", render_mode: str | None = None, **arguments: Any) -> None:
        """Build the world of a scenario or of its name."""
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode = {render_mode!r}: must be None or 'rgb_array'.")
        self.render_mode = render_mode
        self.vector = DrivingVectorEnv(scenario, 1, autoreset=False, **arguments)
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        """Start a new episode."""
        super().reset(seed=None if seed is None else int(seed))  # gymnasium takes no numpy integer
        observations, info = self.vector.reset(seed=seed)
        return observations[0], info

    def step(
        self, action: npt.NDArray[Any]
    ) -> tuple[npt.NDArray[np.float32], SupportsFloat, bool, bool, dict[str, Any]]:
        """Carry out one decision; see `DrivingVectorEnv.step`.

        Raises:
            RuntimeError: The episode has ended, or none has begun.
        """
        if not self.vector.active[0]:
            raise RuntimeError("No episode is running: call reset() first.")
        observations, reward, terminated, truncated, info = self.vector.step(np.asarray(action)[None])
        last = info.get("final_obs", observations)[0]
        plain = {key: info[key][0].item() for key in ("cost", "reward_without_risk", "intervened")}
        return last, float(reward[0]), bool(terminated[0]), bool(truncated[0]), plain

    def render(self) -> Any:
        """The present frame as an RGB array, drawn by highway-env, or None without a render mode."""
        if self.render_mode is None:
            return None
        from envs.rendering import render_world

        return render_world(self.vector.scenario, self.vector.world, 0)

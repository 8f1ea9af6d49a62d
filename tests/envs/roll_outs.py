"""Sources, actions and a shield for tests that drive whole episodes."""

import gymnasium
import numpy as np

from envs.driving_env import ActionMode, action_space
from envs.layout import EpisodeSource
from envs.scenario import get_scenario
from envs.world import BoolArray, FloatArray, World

FULL_THROTTLE = np.array([0.0, 2.0])


def source(name: str, episodes: int | None = None, start: int = 0, seed: int = 11) -> EpisodeSource:
    return EpisodeSource(get_scenario(name), np.random.SeedSequence(seed), start, episodes)


def actions(rng: np.random.Generator, n: int, space: gymnasium.spaces.Box | None = None) -> FloatArray:
    box = space or action_space(ActionMode.ACCELERATION)
    drawn: FloatArray = rng.uniform(box.low, box.high, (n, len(box.low)))
    return drawn


class Recorded:
    """A shield that does what it is told and remembers when it was asked."""

    def __init__(
        self,
        acceleration: float | None = None,
        flag: bool = False,
        target: float | None = None,
        horizon: float | None = None,
    ) -> None:
        self.acceleration, self.flag, self.target, self.horizon = acceleration, flag, target, horizon
        self.observed: list[np.ndarray] = []
        self.asked = 0

    def begin(self, seed: np.random.SeedSequence) -> None:
        pass

    def observe(self, observations: np.ndarray) -> None:
        self.observed.append(observations.copy())

    def filter(
        self, world: World, targets: FloatArray, accelerations: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray | None]:
        self.asked += 1
        n = len(world)
        safe = accelerations if self.acceleration is None else np.full(n, self.acceleration)
        where = targets if self.target is None else np.full(n, self.target)
        return where, safe, np.full(n, self.flag), None if self.horizon is None else np.full(n, self.horizon)

"""Cross-entropy search of a driver's two numbers, behind the barrier guard."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from algorithms.method import Actions, Method, Observations, Policy, Task
from envs.observation import decode
from safedrive_cbf.guard import BarrierGuard

WORLDS: Final = 16
ELITE: Final = 4
GENERATION: Final = 10
"""Decisions for which every world drives with its own candidate."""
LOW, HIGH = np.array([0.0, 0.0]), np.array([13.89, 2.0])
"""Bounds of the desired speed [m/s] and of the gain towards it [1/s]."""


def accelerate(candidates: NDArray[np.float64], speed: NDArray[np.float64]) -> Actions:
    """Lane kept, speed drawn to the wish: actions (N, 2) of candidates (N, 2) at speeds (N,)."""
    commands = np.clip(candidates[:, 1] * (candidates[:, 0] - speed), -2.0, 2.0)
    return np.column_stack([np.zeros(len(speed)), commands])


class SpeedPolicy(Policy):
    """Keeps its lane and a speed, behind the guard."""

    def __init__(self, numbers: NDArray[np.float64]) -> None:
        """Take desired speed [m/s] and gain [1/s]."""
        self.numbers = numbers
        self.shield = BarrierGuard()

    def act(self, observations: Observations) -> Actions:
        """Actions (N, 2) [m, m/s2]."""
        return accelerate(np.tile(self.numbers, (len(observations), 1)), decode(observations).speed)

    def save(self, folder: Path) -> None:
        """Write the two numbers."""
        (folder / "numbers.json").write_text(json.dumps(self.numbers.tolist()))


class BarrierSearch(Method):
    """Cross-entropy method: each world tries a candidate, the best make the next generation.

    Source: Rubinstein (1999). It judges sums of rewards and no value of a next state, hence ``bootstraps = False``.
    """

    version = 1
    bootstraps = False
    defaults: ClassVar[dict[str, Any]] = {"spread": 0.25}

    def train(self, task: Task) -> Policy:
        """Search until the budget is used."""
        rng = np.random.default_rng(task.stream("policy"))
        mean, spread = 0.5 * (LOW + HIGH), self.parameters["spread"] * (HIGH - LOW)
        env = task.make_env(WORLDS, BarrierGuard())
        observations, _ = env.reset()
        left = task.budget.decisions(task.scenario) // WORLDS
        while left:
            candidates = np.clip(rng.normal(mean, spread, (WORLDS, 2)), LOW, HIGH)
            score = np.zeros(WORLDS)
            for _ in range(min(GENERATION, left)):
                observations, rewards, *_ = env.step(accelerate(candidates, decode(observations).speed))
                score += rewards
                left -= 1
            elite = candidates[np.argsort(score)[-ELITE:]]
            mean, spread = elite.mean(axis=0), elite.std(axis=0) + 0.01
            task.progress(env.steps_done, {"reward": float(score.mean())})
        return SpeedPolicy(mean)

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The saved numbers behind the guard."""
        return SpeedPolicy(np.array(json.loads((folder / "numbers.json").read_text())))

"""What a guard knew in each step of an episode: T_c, RQ, importance, limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from algorithms.risk_guard import RiskGuard
from algorithms.safety_guard import SafetyGuard
from envs.world import BoolArray, Ending, FloatArray, Shield, World

IMPORTANCE_AT: Final = 5
"""Numbers of a step before those of each body: T_c, RQ, share, a_pre, a_follow."""


@dataclass(frozen=True, slots=True)
class GuardView:
    """A guard's view of an episode of T steps.

    Attributes:
        tc_s: T_c, shape (T,) [s].
        risk_percent: RQ, shape (T,) [%]; NaN for a guard without a risk model.
        share: Demanded part of S_safe, shape (T,).
        limit_ahead_mps2: a_pre, the most that bodies ahead allow, shape (T,); inf where none counts [m/s2].
        limit_behind_mps2: a_follow, the least that followers demand, shape (T,); -inf where none counts [m/s2].
        importance: IR of each vehicle, then each pedestrian, shape (T, V + P), in [0, 1].
    """

    tc_s: FloatArray
    risk_percent: FloatArray
    share: FloatArray
    limit_ahead_mps2: FloatArray
    limit_behind_mps2: FloatArray
    importance: FloatArray


class ShieldWatch:
    """Stands in for a `SafetyGuard`: answers what it answers, and keeps what it knew of the wanted episodes."""

    def __init__(self, guard: SafetyGuard, seats: Mapping[int, int]) -> None:
        """Watch episodes, given the world by the number of each."""
        self._guard = guard
        self._seats = dict(seats)
        self._steps: dict[int, list[FloatArray]] = {number: [] for number in seats}

    def begin(self, seed: np.random.SeedSequence) -> None:
        """Pass on."""
        self._guard.begin(seed)

    def observe(self, observations: npt.NDArray[np.float32]) -> None:
        """Pass on."""
        self._guard.observe(observations)

    def filter(
        self, world: World, targets: FloatArray, accelerations: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray]:
        """Pass on, and note what the guard knew."""
        answer = self._guard.filter(world, targets, accelerations)
        for number, row in self._seats.items():
            episode = world.episode[row]
            steps = self._steps[number]
            if episode["episode"] == number and episode["ending"] == Ending.RUNNING and episode["steps"] == len(steps):
                steps.append(self._known(world, row))
        return answer

    def _known(self, world: World, row: int) -> FloatArray:
        guard = self._guard
        risk = guard.risk[row] if isinstance(guard, RiskGuard) else math.nan
        first = [guard.horizons(world)[row], risk, guard.shares(world)[row], *guard.limits[row]]
        return np.concatenate([first, guard.importance(world)[row]])

    def view(self, number: int) -> GuardView:
        """What the guard knew in a wanted episode."""
        columns = np.array(self._steps[number]).T
        tc_s, risk_percent, share, ahead, behind = columns[:IMPORTANCE_AT]
        return GuardView(tc_s, risk_percent, share, ahead, behind, columns[IMPORTANCE_AT:].T)


def watch(shield: Shield | None, seats: Mapping[int, int]) -> ShieldWatch | None:
    """A watch on a shield that can say what it knew, else None."""
    return ShieldWatch(shield, seats) if isinstance(shield, SafetyGuard) else None

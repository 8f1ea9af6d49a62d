"""What a stress test found: its figures, and how they are summed over batches of episodes."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from algorithms.versions import GUARD_VERSION
from envs.scenario import STEP_S
from envs.world import Ending, Fault, Records

DD_RQ: Final = "dd-rq"
"""Stands in place of a number for T_c: the risk model sets it."""
Tc = float | Literal["dd-rq"]
WORST_MAX: Final = 100
CLOSEST: Final = 5


@dataclass(frozen=True, slots=True)
class StressResult:
    """What a driver behind a guard did to the traffic, and the traffic to it.

    Attributes:
        scenario: Name and version.
        tc: T_c [s], or ``dd-rq``.
        driver: Who proposed the actions, one of `bench.stress.STRESS_DRIVERS`.
        episodes: Number of episodes.
        seed: Names the stream of episodes and of the driver's draws.
        agent_steps: Budget of the driving agent behind ``dd-rq``'s model, else None.
        options: `GuardOptions`; empty for a shield of another kind.
        guard_version: Version of the guard.
        collisions: Episodes that ended in a collision.
        ego_at_fault: Of these, those that the ego caused (`envs.engine.judge_contact`).
        pedestrian: Of these, contact with a pedestrian.
        rear_ended: Of these, the ego was run into from behind.
        side: Of these, side contact.
        ahead: Of these, the ego ran into a car ahead.
        off_road: Episodes that ended off the road.
        timed_out: Episodes that ended at the time limit.
        intervention_ratio: Flagged steps / all steps of 0.1 s.
        altered_share: Steps whose action was really changed / all steps of 0.1 s.
        mean_speed_mps: Distance / time of each episode, then the mean [m/s].
        worst: Episodes with a collision (at most 100), else the 5 with the least time to collision.
    """

    scenario: str
    tc: Tc
    driver: str
    episodes: int
    seed: int
    agent_steps: int | None
    options: dict[str, bool]
    guard_version: int
    collisions: int
    ego_at_fault: int
    pedestrian: int
    rear_ended: int
    side: int
    ahead: int
    off_road: int
    timed_out: int
    intervention_ratio: float
    altered_share: float
    mean_speed_mps: float
    worst: tuple[int, ...]

    def as_json(self) -> dict[str, Any]:
        """The same as plain values."""
        return {**dataclasses.asdict(self), "worst": list(self.worst)}


class Totals:
    """Sums over batches of finished episodes."""

    def __init__(self) -> None:
        self.episodes = self.steps = self.interventions = self.altered = self.at_fault = 0
        self.faults = np.zeros(len(Fault), np.int64)
        self.endings = np.zeros(len(Ending), np.int64)
        self.speed = 0.0
        self.collided: list[int] = []
        self.closest: list[tuple[float, int]] = []

    def add(self, finished: Records) -> None:
        """Count a batch, in order of episode number."""
        hit = finished["ending"] == Ending.COLLISION
        self.episodes += len(finished)
        self.steps += int(finished["steps"].sum())
        self.interventions += int(finished["interventions"].sum())
        self.altered += int(finished["altered"].sum())
        self.at_fault += int(finished["ego_at_fault"].sum())
        self.faults += np.bincount(finished["fault"][hit], minlength=len(Fault))
        self.endings += np.bincount(finished["ending"], minlength=len(Ending))
        self.speed += float((finished["distance"] / (finished["steps"] * STEP_S)).sum())
        self.collided += finished["episode"][hit].tolist()
        pairs = zip(finished["ttc_min"].tolist(), finished["episode"].tolist(), strict=True)
        self.closest = sorted([*self.closest, *pairs])[:CLOSEST]

    def result(self, **settings: Any) -> StressResult:
        """The figures of all batches, with what was asked for: the first fields of `StressResult` without episodes."""
        worst = self.collided[:WORST_MAX] or [number for _, number in self.closest]
        return StressResult(
            **settings,
            episodes=self.episodes,
            guard_version=GUARD_VERSION,
            collisions=len(self.collided),
            ego_at_fault=self.at_fault,
            pedestrian=int(self.faults[Fault.PEDESTRIAN]),
            rear_ended=int(self.faults[Fault.REAR_ENDED]),
            side=int(self.faults[Fault.SIDE]),
            ahead=int(self.faults[Fault.AHEAD]),
            off_road=int(self.endings[Ending.OFF_ROAD]),
            timed_out=int(self.endings[Ending.TIME_OUT]),
            intervention_ratio=self.interventions / self.steps,
            altered_share=self.altered / self.steps,
            mean_speed_mps=self.speed / self.episodes,
            worst=tuple(worst),
        )

"""Counts and sums of a stage of a record: what pools over seeds without loss."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from bench.errors import RecordError
from bench.records import Record
from bench.schema import column
from bench.statistics import Rate, SeedRate, exact_rate, seed_rate
from envs.scenario import STEP_S
from envs.world import Ending, Fault

Array = npt.NDArray[Any]


@dataclass(frozen=True, slots=True)
class StageCounts:
    """Sums over the finished episodes of one stage; they add up over seeds.

    Attributes:
        stage: ``T`` or ``A``.
        scenarios: Distinct episodes to drive among them: in application all seeds drive the same held-out list.
        episodes: Finished episodes.
        steps: Simulation steps of 0.1 s in them.
        endings: Episodes by `Ending`, shape (5,).
        faults: Collisions by `Fault`, shape (5,).
        ego_at_fault: Collisions with the ego at fault.
        distance_m: Driven [m].
        speed_sum: Sum of each episode's mean speed [m/s].
        step_sums: Sums over steps, by column: interventions, altered, ...
        episode_sums: Sums over episodes, by column: return_driving, ...
        ttc_min_s: Least time to collision of each episode, shape (episodes,) [s].
    """

    stage: str
    scenarios: int
    episodes: int
    steps: int
    endings: Array
    faults: Array
    ego_at_fault: int
    distance_m: float
    speed_sum: float
    step_sums: Array
    episode_sums: Array
    ttc_min_s: Array

    @property
    def collisions(self) -> int:
        """Episodes that ended in a collision."""
        return int(self.endings[Ending.COLLISION])

    @property
    def collision_rate(self) -> Rate:
        """Collisions / episodes, with the exact interval for these policies and new episodes."""
        return exact_rate(self.collisions, self.episodes, independent=self.scenarios)

    @property
    def speed_mps(self) -> float:
        """Distance / time of each episode, then the mean [m/s]; NaN without episodes."""
        return self.speed_sum / self.episodes if self.episodes else math.nan

    @property
    def intervention_ratio(self) -> float:
        """Flagged steps / all steps; NaN without steps."""
        return float(self.step_sums[0]) / self.steps if self.steps else math.nan

    def figures(self) -> dict[str, Any]:
        """Leaderboard columns that are plain quotients."""
        n = self.episodes or math.nan
        shares = {
            name: float(total) / (self.steps or math.nan)
            for name, total in zip(STEP_COLUMNS, self.step_sums, strict=True)
        }
        means = {name: float(total) / n for name, total in zip(EPISODE_COLUMNS, self.episode_sums, strict=True)}
        return {
            "ego_at_fault": self.ego_at_fault,
            "ahead_collisions": int(self.faults[Fault.AHEAD]),
            "side_collisions": int(self.faults[Fault.SIDE]),
            "rear_ended": int(self.faults[Fault.REAR_ENDED]),
            "pedestrian_collisions": int(self.faults[Fault.PEDESTRIAN]),
            "speed_mps": self.speed_mps,
            "intervention_ratio": shares["interventions"],
            "altered_share": shares["altered"],
            "return_without_risk": means["return_driving"] + means["return_comfort"],
            **{name: means[name] for name in ("return_driving", "return_comfort", "return_risk", "lane_changes")},
            "episode_cost": means["cost"],
            **{ending.name.lower(): int(self.endings[ending]) / n for ending in list(Ending)[1:]},
            "ttc_min_median_s": float(np.median(self.ttc_min_s)) if self.episodes else math.nan,
            "inside_safe_gap": shares["steps_inside_safe_gap"],
            "low_ttc": shares["steps_low_ttc"],
            "hard_braking": shares["steps_hard_braking"],
            "jerk_mps3": shares["jerk_sum"],
        }


STEP_COLUMNS: Final = (
    "interventions", "altered", "steps_inside_safe_gap", "steps_low_ttc", "steps_hard_braking", "jerk_sum"
)  # fmt: skip
EPISODE_COLUMNS: Final = ("return_driving", "return_comfort", "return_risk", "cost", "lane_changes")


@functools.cache
def count_record(record: Record, stage: str) -> StageCounts:
    """Counts of stage ``T`` or ``A`` of a record; each table is read once per process.

    Raises:
        RecordError: Its table cannot be used, or holds a number that is none.
    """
    table = record.train_episodes() if stage == "T" else record.eval_episodes()
    _refuse_nan(record, stage, table)
    steps = column(table, "steps").astype(np.int64)
    distance = column(table, "distance").astype(np.float64)
    ending = column(table, "ending").astype(np.int64)
    return StageCounts(
        stage=stage,
        scenarios=table.num_rows,
        episodes=table.num_rows,
        steps=int(steps.sum()),
        endings=np.bincount(ending, minlength=len(Ending)),
        faults=np.bincount(column(table, "fault").astype(np.int64), minlength=len(Fault)),
        ego_at_fault=int(column(table, "ego_at_fault").sum()),
        distance_m=float(distance.sum()),
        speed_sum=float((distance / (STEP_S * steps)).sum()),
        step_sums=np.array([column(table, name).sum(dtype=np.float64) for name in STEP_COLUMNS]),
        episode_sums=np.array([column(table, name).sum(dtype=np.float64) for name in EPISODE_COLUMNS]),
        ttc_min_s=column(table, "ttc_min"),
    )


def _refuse_nan(record: Record, stage: str, table: pa.Table) -> None:
    for field in table.schema:
        if pa.types.is_floating(field.type) and np.isnan(column(table, field.name)).any():
            raise RecordError(
                f"{record.path.name}: {field.name} of stage {stage} holds NaN, so no figure of it can be trusted: "
                "remove the folder and run it again."
            )


def pooled(counts: Sequence[StageCounts]) -> StageCounts:
    """Counts of several seeds of a stage together."""
    merged: dict[str, Any] = {"stage": counts[0].stage, "scenarios": distinct_scenarios(counts)}
    for field in dataclasses.fields(StageCounts):
        if field.name not in merged:
            values = [getattr(c, field.name) for c in counts]
            merged[field.name] = np.concatenate(values) if field.name == "ttc_min_s" else sum(values[1:], values[0])
    return StageCounts(**merged)


def distinct_scenarios(counts: Sequence[StageCounts]) -> int:
    """Distinct episodes to drive among those of several seeds: each trains on its own, all apply to the same list."""
    numbers = [c.scenarios for c in counts]
    return max(numbers) if counts and counts[0].stage == "A" else sum(numbers)


def collision_rate(counts: Sequence[StageCounts], level: float = 0.95) -> SeedRate:
    """Collision rate of several seeds, with an interval for new ones; empty without seeds."""
    events, trials = [c.collisions for c in counts], [c.episodes for c in counts]
    return seed_rate(events or [0], trials or [0], level, distinct_scenarios(counts))

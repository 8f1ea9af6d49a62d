"""How long runs will take: from the rates of finished records, or from stated defaults."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from bench.records import Record
from bench.spec import RunSpec

DEFAULT_TRAIN_RATE: Final = 1_500.0
"""Simulation steps per second of SAC (an update for every 4 decisions of 0.5 s) on one core."""
DEFAULT_EVAL_RATE: Final = 250.0
"""Held-out episodes per second on one core."""
START_S: Final = 4.0
"""Imports of a worker [s]."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Time for a list of runs.

    Attributes:
        seconds: For each run.
        wall_s: In all, on so many workers.
        basis: Where the rates come from.
    """

    seconds: tuple[float, ...]
    wall_s: float
    basis: str


def _median_rates(records: Iterable[Record]) -> dict[tuple[str, str], float]:
    """Median rate by (stage, method name) over finished records."""
    rates: dict[tuple[str, str], list[float]] = {}
    for record in records:
        name = record.spec.method.partition(":")[0]
        timing = record.details.get("timing", {})
        for stage, amount in (("train", record.spec.steps), ("evaluate", record.spec.eval_episodes)):
            seconds = timing.get(stage, {}).get("wall_s", 0.0)
            if amount and seconds > 0.0:
                rates.setdefault((stage, name), []).append(amount / seconds)
    return {key: statistics.median(values) for key, values in rates.items()}


def estimate(specs: Sequence[RunSpec], records: Iterable[Record], workers: int) -> Estimate:
    """Time that runs will take on so many workers."""
    rates = _median_rates(records)
    measured = 0
    seconds = []
    for spec in specs:
        name = spec.method.partition(":")[0]
        measured += ("evaluate", name) in rates
        train = spec.steps / rates.get(("train", name), DEFAULT_TRAIN_RATE)
        seconds.append(train + spec.eval_episodes / rates.get(("evaluate", name), DEFAULT_EVAL_RATE))
    wall = max(sum(seconds) / max(1, workers), max(seconds, default=0.0)) + (START_S if specs else 0.0)
    basis = f"{measured} of {len(specs)} runs at rates measured in this results folder"
    if measured < len(specs):
        basis += (
            f", the rest at an assumed {DEFAULT_TRAIN_RATE:,.0f} training steps/s "
            f"and {DEFAULT_EVAL_RATE:,.0f} episodes/s"
        )
    return Estimate(tuple(seconds), wall, basis)

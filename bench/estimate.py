"""How long runs will take: from the processor time of finished records, or from stated defaults."""

from __future__ import annotations

import heapq
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from algorithms.identity import source_digest
from bench.provenance import CODE, cpu_model
from bench.records import Record
from bench.spec import RunSpec

DEFAULT_TRAIN_RATE: Final = 3_000.0
"""Simulation steps per second of SAC (an update for every 4 decisions of 0.5 s) on one core."""
DEFAULT_EVAL_RATE: Final = 500.0
"""Held-out episodes per second on one core."""
RISK_METHODS: Final = ("dd-rq", "dd-rq-plus")
"""They train a driving agent for the run's own budget and fit a risk model, once for each scenario."""
RISK_MODEL_S: Final = 250.0
"""Data and fit of a risk model on one core [s]."""
START_S: Final = 2.5
"""Imports of a worker [s]."""

ORIGINS: Final = ("", ", by another version of the code", ", on another kind of processor")
"""Records that tell most come first: of this processor and these sources, of this processor, any."""

Key = tuple[str, ...]


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


@dataclass(slots=True)
class _Rates:
    """What finished records say, by (method, scenario) and, for scenarios not seen yet, by (method,).

    Attributes:
        train: Simulation steps per second once training goes.
        evaluate: Held-out episodes per second.
        setup: Seconds before training goes, for what is trained once and shared (a driving agent, a risk model).
    """

    train: dict[Key, list[float]] = field(default_factory=dict)
    evaluate: dict[Key, list[float]] = field(default_factory=dict)
    setup: dict[Key, list[float]] = field(default_factory=dict)

    def add(self, record: Record) -> None:
        """Count a record. Processor time: a run has one thread, and other load leaves it almost as it is."""
        timing: dict[str, dict[str, float]] = record.details.get("timing", {})
        train, evaluate = timing.get("train", {}), timing.get("evaluate", {})
        setup = train.get("cpu_s", 0.0) * _setup_share(record.details.get("timeline", []), train.get("wall_s", 0.0))
        learning = train.get("cpu_s", 0.0) - setup
        for key in _keys(record.spec):
            if record.spec.steps and learning > 0.0:
                self.train.setdefault(key, []).append(record.spec.steps / learning)
                self.setup.setdefault(key, []).append(setup)
            if evaluate.get("cpu_s", 0.0) > 0.0:
                self.evaluate.setdefault(key, []).append(record.spec.eval_episodes / evaluate["cpu_s"])


def _keys(spec: RunSpec) -> tuple[Key, Key]:
    name = spec.method.partition(":")[0]
    return (name, spec.scenario), (name,)


def _setup_share(timeline: Sequence[Sequence[Any]], wall_s: float) -> float:
    """Part of the training's time before its first interval between reports begins, 0 to 1."""
    if len(timeline) < 2 or wall_s <= 0.0:
        return 0.0
    (first_steps, first_s), (second_steps, second_s) = timeline[0], timeline[1]
    before = first_s - (second_s - first_s) * first_steps / max(second_steps - first_steps, 1)
    return float(min(max(before / wall_s, 0.0), 1.0))


def _by_origin(records: Sequence[Record]) -> list[_Rates]:
    """Rates for each of `ORIGINS`."""
    cpu, sources = cpu_model(), source_digest(CODE)
    found = [_Rates() for _ in ORIGINS]
    for record in records:
        made_by = record.details.get("provenance", {})
        own = made_by.get("cpu") == cpu
        for rates, counts in zip(found, (own and made_by.get("source_sha256") == sources, own, True), strict=True):
            if counts:
                rates.add(record)
    return found


def _looked_up(tables: Iterable[dict[Key, list[float]]], spec: RunSpec) -> tuple[list[float], int]:
    """What the first table that knows the method says, and which table that is; nothing if none does."""
    return next(((table[key], at) for at, table in enumerate(tables) for key in _keys(spec) if key in table), ([], 0))


def estimate(specs: Sequence[RunSpec], records: Iterable[Record], workers: int) -> Estimate:
    """Time that runs will take on so many workers, in their order.

    Records of this processor and these sources decide; where there are none, those of this processor, or any. The
    setup of a method is counted once for each scenario and budget that has no record yet.
    """
    records = list(records)
    rates = _by_origin(records)
    made = {(*_keys(record.spec)[0], record.spec.steps) for record in records}
    measured, origin, seconds = 0, 0, []
    for spec in specs:
        train, train_origin = _looked_up((of.train for of in rates), spec)
        evaluate, evaluate_origin = _looked_up((of.evaluate for of in rates), spec)
        measured += bool(evaluate) and (bool(train) or not spec.steps)
        origin = max(origin, evaluate_origin, train_origin)
        needed = spec.steps / (statistics.median(train) if train else DEFAULT_TRAIN_RATE)
        needed += spec.eval_episodes / (statistics.median(evaluate) if evaluate else DEFAULT_EVAL_RATE)
        product = (*_keys(spec)[0], spec.steps)
        if product not in made:
            made.add(product)
            needed += max(_looked_up((of.setup for of in rates), spec)[0] or [_default_setup(spec)])
        seconds.append(needed)
    basis = f"{measured} of {len(specs)} runs at rates measured in this results folder{ORIGINS[origin]}"
    if measured < len(specs):
        basis += (
            f", the rest at an assumed {DEFAULT_TRAIN_RATE:,.0f} training steps/s "
            f"and {DEFAULT_EVAL_RATE:,.0f} episodes/s"
        )
    return Estimate(tuple(seconds), _makespan(seconds, workers), basis)


def _default_setup(spec: RunSpec) -> float:
    if spec.method.partition(":")[0] not in RISK_METHODS:
        return 0.0
    return RISK_MODEL_S + spec.steps / DEFAULT_TRAIN_RATE


def _makespan(seconds: Sequence[float], workers: int) -> float:
    """Wall time of runs that are handed out in order to whoever is free [s]."""
    free = [START_S] * max(1, workers) if seconds else [0.0]
    for needed in seconds:
        heapq.heappush(free, heapq.heappop(free) + needed)
    return max(free)

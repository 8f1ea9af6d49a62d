"""How long runs will take: from the processor time of finished records, or from stated defaults."""

from __future__ import annotations

import functools
import heapq
import statistics
from collections import defaultdict
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from algorithms.identity import source_digest
from algorithms.registry import get_method
from bench.provenance import CODE, cpu_model
from bench.records import Record
from bench.spec import RunSpec

DEFAULT_TRAIN_RATE: Final = 3_000.0
"""Simulation steps per second of SAC (an update for every 4 decisions of 0.5 s) on one core."""
DEFAULT_ON_POLICY_RATE: Final = 9_000.0
"""The same of methods built on OmniSafe: CPO, FOCOPS and TRPO-Lag, 8,400 to 9,800 in results/speed/protocol.json."""
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


class _Kind(NamedTuple):
    """What records share whose rates are pooled; `origin` counts in `ORIGINS`."""

    method: str
    scenario: str
    settings: frozenset[tuple[str, str]]
    origin: int


class _Distance(NamedTuple):
    """How far records are from a run of the same method; tuples compare item by item, so that this is the order.

    Settings come first: one update for each decision takes 16 times as long as one for 16, while sources and processor
    have made a difference of two so far. A setting typed at its default value counts as another one: only the method
    knows its defaults, and records without any setting are then the nearest.

    Attributes:
        lacking: Settings of the run that the records were made without.
        beyond: Settings of the records that the run is without.
        origin: As in `ORIGINS`.
        other_parameters: Whether the method's parameters differ.
        other_scenario: Whether the scenario differs.
    """

    lacking: int
    beyond: int
    origin: int
    other_parameters: bool
    other_scenario: bool

    @classmethod
    def between(cls, kind: _Kind, spec: RunSpec) -> _Distance:
        wanted = frozenset(spec.settings.items())
        return cls(
            len(wanted - kind.settings),
            len(kind.settings - wanted),
            kind.origin,
            kind.method != spec.method,
            kind.scenario != spec.scenario,
        )

    @property
    def of_setup(self) -> tuple[int, bool]:
        """The order for what is made once and shared: by runs of all settings and parameters."""
        return self.origin, self.other_scenario


Table = dict[_Kind, list[float]]


@dataclass(slots=True)
class _Rates:
    """What finished records of one method say.

    Attributes:
        train: Simulation steps per second once training goes.
        evaluate: Held-out episodes per second.
        setup: Seconds before training goes, for what is trained once and shared (a driving agent, a risk model).
    """

    train: Table = field(default_factory=dict)
    evaluate: Table = field(default_factory=dict)
    setup: Table = field(default_factory=dict)

    def add(self, record: Record, origin: int) -> None:
        """Count a record. Processor time: a run has one thread, and other load leaves it almost as it is."""
        spec = record.spec
        kind = _Kind(spec.method, spec.scenario, frozenset(spec.settings.items()), origin)
        timing: dict[str, dict[str, float]] = record.details.get("timing", {})
        train, evaluate = timing.get("train", {}), timing.get("evaluate", {})
        setup = train.get("cpu_s", 0.0) * _setup_share(record.details.get("timeline", []), train.get("wall_s", 0.0))
        learning = train.get("cpu_s", 0.0) - setup
        if spec.steps and learning > 0.0:
            self.train.setdefault(kind, []).append(spec.steps / learning)
            self.setup.setdefault(kind, []).append(setup)
        if evaluate.get("cpu_s", 0.0) > 0.0:
            self.evaluate.setdefault(kind, []).append(spec.eval_episodes / evaluate["cpu_s"])


def _name(spec: RunSpec) -> str:
    return spec.method.partition(":")[0]


def _setup_share(timeline: Sequence[Sequence[Any]], wall_s: float) -> float:
    """Part of the training's time before its first interval between reports begins, 0 to 1."""
    if len(timeline) < 2 or wall_s <= 0.0:
        return 0.0
    (first_steps, first_s), (second_steps, second_s) = timeline[0], timeline[1]
    before = first_s - (second_s - first_s) * first_steps / max(second_steps - first_steps, 1)
    return float(min(max(before / wall_s, 0.0), 1.0))


def _by_method(records: Iterable[Record]) -> defaultdict[str, _Rates]:
    """Rates by the method's name."""
    cpu, sources = cpu_model(), source_digest(CODE)
    rates: defaultdict[str, _Rates] = defaultdict(_Rates)
    for record in records:
        made_by = record.details.get("provenance", {})
        own = made_by.get("cpu") == cpu
        origin = (0 if made_by.get("source_sha256") == sources else 1) if own else 2
        rates[_name(record.spec)].add(record, origin)
    return rates


def _nearest(table: Table, spec: RunSpec) -> tuple[list[float], _Distance | None]:
    """What the records nearest to a run say, and how far they are from it; nothing if there are none."""
    nearest = min((_Distance.between(kind, spec) for kind in table), default=None)
    return [value for kind in table if _Distance.between(kind, spec) == nearest for value in table[kind]], nearest


def _setup(table: Table, spec: RunSpec) -> float:
    """Time for what is made once and shared: the longest that the nearest records tell of, or the default [s]."""
    order = {kind: _Distance.between(kind, spec).of_setup for kind in table}
    nearest = min(order.values(), default=None)
    return max((max(table[kind]) for kind in table if order[kind] == nearest), default=_default_setup(spec))


def estimate(specs: Sequence[RunSpec], records: Iterable[Record], workers: int) -> Estimate:
    """Time that runs will take on so many workers, in their order.

    The nearest records of a method decide, see `_Distance`. The setup of a method is counted once for each scenario and
    budget that has no record yet.
    """
    records = list(records)
    rates = _by_method(records)
    made = {(_name(record.spec), record.spec.scenario, record.spec.steps) for record in records}
    measured, seconds = 0, []
    distances: set[_Distance] = set()
    for spec in specs:
        of_method = rates[_name(spec)]
        train, train_distance = _nearest(of_method.train, spec)
        evaluate, evaluate_distance = _nearest(of_method.evaluate, spec)
        measured += bool(evaluate) and (bool(train) or not spec.steps)
        distances.update(filter(None, (train_distance, evaluate_distance)))
        needed = spec.steps / (statistics.median(train) if train else _default_train_rate(spec.method))
        needed += spec.eval_episodes / (statistics.median(evaluate) if evaluate else DEFAULT_EVAL_RATE)
        product = (_name(spec), spec.scenario, spec.steps)
        if product not in made:
            made.add(product)
            needed += _setup(of_method.setup, spec)
        seconds.append(needed)
    return Estimate(tuple(seconds), _makespan(seconds, workers), _basis(measured, len(specs), distances))


def _basis(measured: int, runs: int, distances: Collection[_Distance]) -> str:
    text = f"{measured} of {runs} runs at rates measured in this results folder"
    text += ORIGINS[max((distance.origin for distance in distances), default=0)]
    if any(distance.lacking or distance.beyond for distance in distances):
        text += ", some with other settings"
    if measured < runs:
        text += (
            f", the rest at an assumed {DEFAULT_TRAIN_RATE:,.0f} training steps/s, "
            f"{DEFAULT_ON_POLICY_RATE:,.0f} by OmniSafe, and {DEFAULT_EVAL_RATE:,.0f} episodes/s"
        )
    return text


@functools.cache
def _default_train_rate(method: str) -> float:
    from algorithms.omnisafe_methods import OnPolicyMethod  # here: not every estimate needs it

    return DEFAULT_ON_POLICY_RATE if isinstance(get_method(method), OnPolicyMethod) else DEFAULT_TRAIN_RATE


def _default_setup(spec: RunSpec) -> float:
    if _name(spec) not in RISK_METHODS:
        return 0.0
    return RISK_MODEL_S + spec.steps / DEFAULT_TRAIN_RATE


def _makespan(seconds: Sequence[float], workers: int) -> float:
    """Wall time of runs that are handed out in order to whoever is free [s]."""
    free = [START_S] * max(1, workers) if seconds else [0.0]
    for needed in seconds:
        heapq.heappush(free, heapq.heappop(free) + needed)
    return max(free)

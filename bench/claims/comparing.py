"""How a comparison of two groups of runs is judged: enough seeds, an interval, a bound; tests on paired episodes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from bench.claims.evidence import Group, collided
from bench.claims.verdict import Part, Verdict, shortfall
from bench.statistics import (
    Estimate,
    Interval,
    PairedScores,
    holm,
    mcnemar_exact,
    rate_difference,
)
from bench.summary import collision_rate

Estimator = Callable[[float], Estimate]
"""The effect with an interval of the given level."""

LEVEL: Final = 0.95
SEEDS_MIN: Final = 3
"""Fewer seeds do not speak for a method."""
EPISODES_MIN: Final = 1_000
"""Of each method and stage, all seeds together."""


def compared(
    name: str,
    groups: Sequence[Group],
    estimator: Estimator,
    *,
    bound: float,
    tests: int,
    show: Callable[[Estimate], str],
    paper: float = math.nan,
    below: bool = False,
) -> Part:
    """A comparison that should lie beyond a bound.

    Reproduced if the 95 % interval lies beyond it; not reproduced if the interval of level 1 - 0.05 / tests, so that
    all refutations of the claim hold together, lies short of it.
    """
    if not all(group.records for group in groups):
        return empty_part(name, groups, paper)
    estimate = estimator(LEVEL)
    lacks = shortfall(groups, SEEDS_MIN, EPISODES_MIN)
    wide = estimator(1.0 - (1.0 - LEVEL) / tests).interval
    decided = not lacks and not estimate.interval.empty
    verdict = _beyond(estimate.interval, wide, bound, below) if decided else Verdict.UNDECIDED
    margin = bound - estimate.value if below else estimate.value - bound
    text = show(estimate)
    reason = f"{name}: {text}"
    return Part(name, verdict, estimate.value, estimate.interval, margin, text, tuple(groups), reason, lacks, paper)


def _beyond(interval: Interval, wide: Interval, bound: float, below: bool) -> Verdict:
    if interval.high <= bound if below else interval.low > bound:
        return Verdict.REPRODUCED
    if wide.low > bound if below else wide.high < bound:
        return Verdict.NOT_REPRODUCED
    return Verdict.UNDECIDED


def in_text(form: str, estimate: Estimate, scale: float = 1.0, unit: str = "") -> str:
    """An estimate with its interval, each number in the given format; without an interval it says so."""
    value, low, high = (scale * x for x in (estimate.value, estimate.interval.low, estimate.interval.high))
    span = "no interval" if estimate.interval.empty else f"{low:{form}} to {high:{form}}"
    return f"{value:{form}}{unit and ' '}{unit} ({span})"


def empty_part(name: str, groups: Sequence[Group], paper: float) -> Part:
    """A part of which nothing can be said."""
    lacks = shortfall(groups, SEEDS_MIN, EPISODES_MIN)
    none = Interval.none(LEVEL)
    return Part(name, Verdict.UNDECIDED, math.nan, none, math.nan, "no runs", tuple(groups), name, lacks, paper)


def rates_apart(first: Group, second: Group, level: float) -> Estimate:
    """Collision rate of first minus that of second."""
    return rate_difference(collision_rate(first.counts, level), collision_rate(second.counts, level))


def paired(parts: Sequence[Part]) -> list[Part]:
    """Application parts with McNemar's exact test on the common held-out list, Holm over the baselines."""
    tested = {i: p for i, part in enumerate(parts) if (p := _mcnemar(part)) is not None}
    adjusted = dict(zip(tested, holm(list(tested.values())), strict=True)) if tested else {}
    changed = list(parts)
    for i, p_value in adjusted.items():
        part = parts[i]
        verdict, reason = part.verdict, f"{part.reason}, McNemar p {_p_text(p_value)}"
        if verdict is Verdict.REPRODUCED and p_value > 1.0 - LEVEL:
            verdict = Verdict.UNDECIDED
        changed[i] = dataclasses.replace(part, verdict=verdict, reason=reason)
    return changed


def _p_text(p_value: float) -> str:
    return "< 0.0001" if p_value < 1e-4 else f"{p_value:.4f}"


def _mcnemar(part: Part) -> float | None:
    """Its p value on the seeds that both methods have; None in training, where episodes have no partners."""
    ours, theirs = part.groups
    seeds = sorted({r.spec.seed for r in ours.records} & {r.spec.seed for r in theirs.records})
    if ours.stage == "T" or not seeds:
        return None
    flags = [np.array([collided(r) for r in group.records if r.spec.seed in seeds]) for group in (ours, theirs)]
    numbers = range(flags[0].shape[1])
    return mcnemar_exact(PairedScores(numbers, flags[0], numbers, flags[1])).p_value

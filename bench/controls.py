"""Which part matters? A method against its controls, which have everything but that part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from bench.selection import Selection
from bench.statistics import Estimate, mean_difference
from bench.summary import StageCounts

Value = Callable[[StageCounts], float]

CONTROLS: Final[dict[str, tuple[str, ...]]] = {
    "dd-rq": ("dd-rq:tc=mean", "dd-rq:rq=shuffled"),
    "dd-rq-plus": (
        "dd-rq-plus:share=mean",
        "dd-rq-plus:share=shuffled",
        "dd-rq-plus:aware=False",
        "safety-guard:aware=True",
        "safety-guard:aware=True,share=0.0",
    ),
}


@dataclass(frozen=True, slots=True)
class Measure:
    """What a method could do better than its control.

    Attributes:
        name: For people.
        stage: ``T`` or ``A``.
        value: Of one seed.
        scale: To the unit shown.
        unit: Shown.
        sign: +1 where more is better, -1 where less is.
    """

    name: str
    stage: str
    value: Value
    scale: float
    unit: str
    sign: int


MEASURES: Final = tuple(
    measure
    for stage in "TA"
    for measure in (
        Measure("speed", stage, lambda c: c.speed_mps, 1.0, "m/s", 1),
        Measure("interventions", stage, lambda c: c.intervention_ratio, 100.0, "points", -1),
    )
)
LEVEL: Final = 1.0 - 0.05 / len(MEASURES)
"""Bonferroni: all intervals of one comparison hold together with 95 %."""


def remarks(selection: Selection, scenario: str) -> list[str]:
    """One line for each method and control that both have at least two seeds; none where nothing can be said."""
    lines = []
    for method, controls in CONTROLS.items():
        for control in controls:
            line = _compare(selection, scenario, method, control)
            if line:
                lines.append(line)
    return lines


def _compare(selection: Selection, scenario: str, method: str, control: str) -> str:
    shown, better, worse = [], [], []
    for measure in MEASURES:
        first, second = (
            [measure.scale * measure.value(c) for c in selection.counts(scenario, name, measure.stage) if c.episodes]
            for name in (method, control)
        )
        if min(len(first), len(second)) < 2:
            return ""
        estimate = mean_difference(first, second, LEVEL)
        shown.append(f"{measure.name} {measure.stage} {_text(estimate, measure.unit)}")
        low, high = sorted((measure.sign * estimate.interval.low, measure.sign * estimate.interval.high))
        if low > 0.0:
            better.append(f"{measure.name} {measure.stage}")
        if high < 0.0:
            worse.append(f"{measure.name} {measure.stage}")
    verdicts = [f"{word} in {' and '.join(names)}" for word, names in (("better", better), ("worse", worse)) if names]
    verdict = ", ".join(verdicts) or "neither better nor worse as far as these seeds can show"
    return f"{method} minus its control {control}: {', '.join(shown)}: {verdict}."


def _text(estimate: Estimate, unit: str) -> str:
    return f"{estimate.value:+.2f} {unit} ({estimate.interval.low:+.2f} to {estimate.interval.high:+.2f})"

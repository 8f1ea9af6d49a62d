"""Speed and return in application as interquartile means, and the probability that DD-RQ improves on each method.

Source: Agarwal et al., Deep reinforcement learning at the edge of the statistical precipice (2021), arXiv 2108.13264.
The columns of `bench.statistics`' scores are the episodes of the common held-out list.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from algorithms import atomic
from bench.records import Collection
from bench.shown import SCENARIOS, Runs, returns, runs, speeds
from bench.statistics import Estimate, iqm_interval, probability_of_improvement_interval
from bench.text import csv_text

OURS: Final = ("dd-rq", "dd-rq-plus")
SCORES: Final = {"speed": "m/s", "return": "without r_risk"}
_SCORE: Final = {"speed": speeds, "return": returns}
SEED: Final = 0
"""Of the bootstrap's draws: the same records give the same figures."""

Row = dict[str, str]


def rows(collection: Collection) -> list[Row]:
    """One row for each scenario and method that the tables show; cells without an estimate are empty."""
    found: list[Row] = []
    for scenario in SCENARIOS:
        chosen = {entry.method: entry for entry in runs(collection, scenario)}
        found += [_row(scenario, entry, chosen) for entry in chosen.values()]
    return found


def _row(scenario: str, entry: Runs, chosen: dict[str, Runs]) -> Row:
    row: Row = {"scenario": scenario, "method": entry.method, "seeds": str(len(entry.records))}
    for name in SCORES:
        theirs = _scores(entry, name)
        _put(row, f"{name}_iqm", iqm_interval(theirs, np.random.default_rng(SEED)))
        for ours in OURS:
            other = chosen.get(ours)
            comparable = other is not None and ours != entry.method and _episodes(other) == _episodes(entry)
            _put(row, f"{name}_{ours}_improves", _improvement(other, theirs, name) if comparable and other else None)
    return row


def _improvement(ours: Runs, theirs: npt.NDArray[np.float64], name: str) -> Estimate:
    return probability_of_improvement_interval(_scores(ours, name), theirs, np.random.default_rng(SEED))


def _episodes(entry: Runs) -> int:
    return entry.records[0].spec.eval_episodes


def _scores(entry: Runs, name: str) -> npt.NDArray[np.float64]:
    """Shape (seeds, held-out episodes)."""
    return np.stack([_SCORE[name](record) for record in entry.records])


def _put(row: Row, name: str, estimate: Estimate | None) -> None:
    values = (math.nan,) * 3
    if estimate is not None:
        values = (estimate.value, estimate.interval.low, estimate.interval.high)
    for suffix, value in zip(("", "_low", "_high"), values, strict=True):
        row[name + suffix] = "" if math.isnan(value) else f"{value:.6g}"


def write(results: Path, found: Sequence[Row]) -> tuple[Path, Path]:
    """Write ``improvement.csv`` and ``improvement.md``; the same rows give the same bytes."""
    results.mkdir(parents=True, exist_ok=True)
    paths = results / "improvement.csv", results / "improvement.md"
    heading = list(found[0]) if found else ["scenario", "method", "seeds"]
    atomic.write_file(paths[0], csv_text(heading, (list(row.values()) for row in found)).encode())
    atomic.write_file(paths[1], _markdown(found).encode())
    return paths


def _markdown(found: Sequence[Row]) -> str:
    lines = [
        "# Speed and return",
        "",
        "Application, held-out list. IQM: interquartile mean over seeds and episodes. Then the probability that a seed "
        "of dd-rq, or of dd-rq-plus, exceeds one of the row's method in an episode, ties one half. In brackets 95 % "
        "intervals over seeds; a single seed has none.",
    ]
    head = ["method", "seeds"]
    head += [f"{name} IQM, {unit}" for name, unit in SCORES.items()]
    head += [f"{ours} exceeds, {name}" for name in SCORES for ours in OURS]
    keys = [f"{name}_iqm" for name in SCORES] + [f"{name}_{ours}_improves" for name in SCORES for ours in OURS]
    for scenario in dict.fromkeys(row["scenario"] for row in found):
        lines += ["", f"## {scenario}", "", f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
        for row in found:
            if row["scenario"] == scenario:
                cells = [row["method"], row["seeds"], *(_text(row, key) for key in keys)]
                lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _text(row: Row, key: str) -> str:
    places = 0 if key == "return_iqm" else 2
    values = [f"{float(row[name]):.{places}f}" if row[name] else "" for name in (key, f"{key}_low", f"{key}_high")]
    return f"{values[0]} ({values[1]} to {values[2]})" if values[1] else values[0]

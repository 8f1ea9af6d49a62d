"""What the report shows, as plain values: leaderboard, tables, claims, runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from bench import claims, leaderboard, learning_curve, tables
from bench.published import TITLES
from bench.records import Collection, Record
from bench.statistics import format_rate
from bench.summary import count_record
from bench.table_files import Cell, Table
from envs.scenario import STEP_S

WINDOWS: Final = 40
"""Points of a learning curve."""
STAGE_FIGURES: Final = (
    "speed_mps", "intervention_ratio", "altered_share", "return_without_risk", "episode_cost", "goal", "off_road",
    "time_out", "ttc_min_median_s", "inside_safe_gap", "low_ttc", "hard_braking", "jerk_mps3", "lane_changes",
)  # fmt: skip


def content(collection: Collection) -> dict[str, Any]:
    """All but the replays; numbers with six significant digits, None where there is none.

    Raises:
        RecordError: A record cannot be used.
    """
    ranked = leaderboard.rows(collection.records)
    return {
        "columns": leaderboard.COLUMNS,
        "ranking": f"{leaderboard.RANKING} {leaderboard.BRACKETS}",
        "leaderboard": [{**plain(row), "collision_text": leaderboard.collision_text(row)} for row in ranked],
        "tables": [_table(tables.build(name, collection)) for name in TITLES],
        "claims": claims.as_values(claims.judge(collection)),
        "runs": [_run(record) for record in collection.records],
        "missing": [{"run": missing.spec.label, "reason": missing.reason} for missing in collection.missing],
    }


def plain(value: Any) -> Any:
    """A value for JSON: six significant digits; None for what is no finite number."""
    if isinstance(value, dict):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value


def _table(table: Table) -> dict[str, Any]:
    notes = table.notes()
    return {
        "title": table.title,
        "caption": table.caption,
        "columns": table.columns(),
        "seeds": table.seeds(),
        "rows": [
            {"row": row, "stage": stage, "cells": [_cell(cell, notes) for cell in cells]}
            for row, stage, cells in table.rows()
        ],
        "notes": notes,
        "remarks": list(table.remarks),
    }


def _cell(cell: Cell, notes: Sequence[str]) -> dict[str, Any]:
    published = f"{cell.figure.value} {cell.figure.unit}" if cell.figure.value else ""
    note = notes.index(cell.reason) + 1 if cell.reason else 0
    return {"ours": cell.text, "paper": published, "note": note}


def _run(record: Record) -> dict[str, Any]:
    spec = record.spec
    stages = ("T", "A") if record.details.get("trains", True) else ("A",)
    return {
        "id": record.path.name,
        "method": spec.method,
        "scenario": spec.scenario_id,
        "seed": spec.seed,
        "config": plain(spec.model_dump()),
        "provenance": plain(record.details.get("provenance", {})),
        "timing": plain(record.details.get("timing", {})),
        "stages": {stage: _stage(record, stage) for stage in stages},
        "curve": _curve(record) if "T" in stages else None,
    }


def _stage(record: Record, stage: str) -> dict[str, Any]:
    counts = count_record(record, stage)
    figures = counts.figures()
    return {
        "episodes": counts.episodes,
        "hours": plain(counts.steps * STEP_S / 3600.0),
        "collisions": counts.collisions,
        "collision_text": format_rate(counts.collision_rate) if counts.episodes else "",
        **{name: plain(figures[name]) for name in STAGE_FIGURES},
    }


def _curve(record: Record) -> dict[str, Any] | None:
    """Training in `WINDOWS` windows, None for a run that is too short."""
    width = record.spec.steps // WINDOWS
    if width < 1:
        return None
    curve = learning_curve.of(record, width)

    def short(values: Any) -> list[float | None]:
        return [float(f"{value:.4g}") if math.isfinite(value) else None for value in values.tolist()]

    return {
        "steps": curve.stop.tolist(),
        "return": short(curve.returns),
        "collision_rate": short(curve.collision_rates),
        "speed_mps": short(curve.speeds_mps),
        "intervention_ratio": short(curve.intervention_ratios),
    }

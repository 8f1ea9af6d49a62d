"""The leaderboard: one row for each method, scenario and stage, from records alone; columns: `COLUMNS`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from algorithms import atomic
from bench.records import Record
from bench.statistics import Interval, collisions_per_1000_km, exact_rate, format_rate
from bench.summary import StageCounts, collision_rate, count_record, pooled
from bench.text import csv_text

Row = dict[str, Any]

RANKING: Final = (
    "Ranked safe first, then fast: all that cannot be told from the safest are tied on safety and ordered by speed, "
    "then the rest in the same way."
)

TOLD_APART: Final = 0.834
"""Level of intervals that just touch where a difference is significant at 5 %; those of 95 % tie what differs.

Source: Goldstein and Healy, The graphical presentation of a collection of means (1995), for equal standard errors.
"""
_SPAN: Final = "interval that ranks"

COLUMNS: Final[dict[str, str]] = {
    "rank": "within scenario, stage and cost: safe first, then fast",
    "method": "with the parameters that differ from their defaults",
    "method_version": "version of the method's results",
    "scenario": "name and version",
    "stage": "T training, A application on the held-out list",
    "steps": "simulation steps of 0.1 s for training; 0 for a driver that does not train",
    "eval_episodes": "held-out episodes for each seed",
    "cost_limit": "bound on the undiscounted episode cost",
    "cost_signal": "what costs 1",
    "settings": "method settings that were given",
    "seeds": "number of seeds",
    "episodes": "finished episodes, all seeds",
    "scenarios": "distinct episodes to drive among them: in application all seeds drive the same list",
    "collisions": "episodes that ended in a collision",
    "collision_rate": "collisions / episodes",
    "collision_low": "exact 95 % interval (Clopper-Pearson, each distinct episode once): for these policies",
    "collision_high": "its upper end",
    "collision_seeds_low": "95 % interval for new seeds (bench.statistics.seed_rate), of two seeds and more",
    "collision_seeds_high": "its upper end",
    "collisions_by_seed": "collisions/episodes of each seed",
    "ego_at_fault": "collisions with the ego at fault",
    "ahead_collisions": "ran into a vehicle ahead",
    "side_collisions": "side contact",
    "rear_ended": "was hit from behind",
    "pedestrian_collisions": "hit a pedestrian",
    "collisions_per_1000_km": "collisions by distance driven",
    "speed_mps": "distance / time of each episode, then the mean [m/s]",
    "intervention_ratio": "steps that the shield flagged / all steps",
    "altered_share": "steps in which the shield changed the action / all steps",
    "return_without_risk": "mean of return_driving + return_comfort",
    "return_driving": "mean of r_s + r_c + r_ld over the episode",
    "return_comfort": "mean of r_cf over the episode",
    "return_risk": "mean of r_risk over the episode",
    "episode_cost": "mean undiscounted cost",
    "goal": "share of episodes that ended so",
    "collision": "share",
    "off_road": "share",
    "time_out": "share",
    "ttc_min_median_s": "median over episodes of the least time to collision [s]; inf: never closed in",
    "inside_safe_gap": "share of steps with a gap ahead below 3.6 v",
    "low_ttc": "share of steps with a time to collision below 1.5 s",
    "hard_braking": "share of steps at or below -1.8 m/s2",
    "jerk_mps3": "mean of abs(jerk)",
    "lane_changes": "mean of each episode",
    "wall_s": "seconds of this stage, mean of the seeds",
    "cpu_s": "processor seconds of this stage, mean of the seeds",
    "steps_per_s": "simulation steps of this stage per wall second",
    "commit": "code of the records, + where it differed from the commit",
}


def rows(records: Iterable[Record]) -> list[Row]:
    """Leaderboard rows of records, ranked as `RANKING` says.

    Raises:
        RecordError: A record's tables cannot be used.
    """
    groups: dict[tuple[object, ...], list[Record]] = {}
    for record in records:
        groups.setdefault(record.spec.variant, []).append(record)
    found: list[Row] = []
    for group in groups.values():
        group.sort(key=lambda record: record.spec.seed)
        for stage in ("T", "A"):
            if stage == "A" or group[0].details.get("trains", True):
                found.append(_row(group, stage))
    return _ranked(found)


def _row(group: Sequence[Record], stage: str) -> Row:
    spec = group[0].spec
    counts = [count_record(record, stage) for record in group]
    timing = [record.details["timing"]["train" if stage == "T" else "evaluate"] for record in group]
    wall = sum(entry["wall_s"] for entry in timing)
    return {
        "method": spec.method,
        "method_version": spec.method_version,
        "scenario": spec.scenario_id,
        "stage": stage,
        "steps": spec.steps,
        "eval_episodes": spec.eval_episodes,
        "cost_limit": spec.cost_limit,
        "cost_signal": spec.cost_signal,
        "settings": " ".join(f"{key}={value}" for key, value in spec.settings.items()),
        "seeds": len(group),
        **_figures(counts),
        "wall_s": wall / len(group),
        "cpu_s": sum(entry["cpu_s"] for entry in timing) / len(group),
        "steps_per_s": sum(c.steps for c in counts) / wall if wall > 0.0 else math.nan,
        "commit": " ".join(sorted({_commit(record) for record in group})),
    }


def _figures(counts: Sequence[StageCounts]) -> Row:
    total = pooled(counts)
    exact = total.collision_rate
    replicated = sum(c.episodes > 0 for c in counts) > 1
    over_seeds = collision_rate(counts).interval if replicated else Interval.none()
    told_apart = collision_rate(counts, TOLD_APART).interval
    km = total.distance_m / 1000.0
    return {
        "episodes": total.episodes,
        "scenarios": total.scenarios,
        "collisions": total.collisions,
        "collision_rate": exact.value,
        "collision_low": exact.low,
        "collision_high": exact.high,
        "collision_seeds_low": over_seeds.low,
        "collision_seeds_high": over_seeds.high,
        "collisions_by_seed": " ".join(f"{c.collisions}/{c.episodes}" for c in counts),
        "collisions_per_1000_km": collisions_per_1000_km(total.collisions, km).per_1000_km,
        **total.figures(),
        _SPAN: (told_apart.low, told_apart.high),
    }


def _commit(record: Record) -> str:
    git = record.details.get("provenance", {}).get("git", {})
    return (git.get("commit") or "unknown")[:12] + ("+" if git.get("dirty") else "")


def _ranked(found: list[Row]) -> list[Row]:
    """Rows in order of scenario, stage (A first), budget and rank."""
    tables: dict[tuple[Any, ...], list[Row]] = {}
    for row in found:
        key = (row["scenario"], row["stage"], row["cost_signal"], row["cost_limit"])
        tables.setdefault(key, []).append(row)
    ordered: list[Row] = []
    for key in sorted(tables):
        left = sorted(tables[key], key=lambda row: (_or_inf(row["collision_rate"]), _name(row)))
        place = 0
        while left:
            # The safest left, and all that its interval does not tell apart from it.
            limit = _or_inf(left[0][_SPAN][1])
            tied = [row for row in left if row is left[0] or _or_inf(row[_SPAN][0]) <= limit]
            for row in sorted(tied, key=lambda row: (-_or_zero(row["speed_mps"]), _name(row))):
                place += 1
                ordered.append({"rank": place, **row})
            left = [row for row in left if not any(row is other for other in tied)]
    for row in ordered:
        del row[_SPAN]
    return ordered


def _name(row: Row) -> tuple[Any, ...]:
    return (row["method"], row["steps"], row["eval_episodes"], row["settings"])


def _or_inf(value: float) -> float:
    return math.inf if math.isnan(value) else value


def _or_zero(value: float) -> float:
    return 0.0 if math.isnan(value) else value


def write(results: Path, ranked: Sequence[Row]) -> tuple[Path, Path]:
    """Write ``leaderboard.csv`` and ``leaderboard.md``; the same rows give the same bytes."""
    results.mkdir(parents=True, exist_ok=True)
    paths = results / "leaderboard.csv", results / "leaderboard.md"
    atomic.write_file(paths[0], to_csv(ranked).encode())
    atomic.write_file(paths[1], to_markdown(ranked).encode())
    return paths


def to_csv(ranked: Sequence[Row]) -> str:
    """All columns."""
    return csv_text(list(COLUMNS), ([number(row[name]) for name in COLUMNS] for row in ranked))


def number(value: Any) -> str:
    """A cell: six significant digits, empty where there is no number."""
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.6g}"
    return str(value)


def collision_text(row: Row) -> str:
    """Collisions as k/n with the exact interval, or a zero with its bound."""
    return format_rate(exact_rate(row["collisions"], row["episodes"], independent=row["scenarios"]))


BRACKETS: Final = (
    "In brackets the exact 95 % interval for these policies, a zero with its one-sided bound; both count an episode of "
    "the held-out list once, however many seeds drive it. 'New seeds' is the 95 % interval for policies trained with "
    "other seeds, of methods with two seeds and more."
)
MARKDOWN: Final = (
    "rank", "method", "seeds", "collisions", "new seeds", "at fault", "speed m/s", "interventions", "return",
    "goal",
)  # fmt: skip


def to_markdown(ranked: Sequence[Row]) -> str:
    """The columns that matter most, a table for each scenario and stage."""
    lines = ["# Leaderboard", "", f"{RANKING} {BRACKETS}"]
    heading: tuple[str, ...] = ()
    for row in ranked:
        stage = "training (T)" if row["stage"] == "T" else "application (A)"
        limit = "" if row["cost_signal"] == "collision" else f", cost signal {row['cost_signal']}"
        title = (f"{row['scenario']}, {stage}, cost limit {row['cost_limit']:g}{limit}",)
        if title != heading:
            heading = title
            lines += ["", f"## {title[0]}", "", f"| {' | '.join(MARKDOWN)} |", "|" + "---|" * len(MARKDOWN)]
        lines.append("| " + " | ".join(_markdown_cells(row)) + " |")
    return "\n".join(lines).rstrip() + "\n"


def _markdown_cells(row: Row) -> list[str]:
    low, high = row["collision_seeds_low"], row["collision_seeds_high"]
    budget = f" ({row['steps']:,} steps)" if row["steps"] else ""
    return [
        str(row["rank"]),
        f"{row['method']}{' ' + row['settings'] if row['settings'] else ''}{budget}",
        str(row["seeds"]),
        collision_text(row),
        "" if math.isnan(low) else f"{100 * low:.2f} to {100 * high:.2f} %",
        str(row["ego_at_fault"]),
        _decimals(row["speed_mps"], 2),
        _percent(row["intervention_ratio"]),
        _decimals(row["return_without_risk"], 1),
        _percent(row["goal"]),
    ]


def _decimals(value: float, places: int) -> str:
    return "" if math.isnan(value) else f"{value:.{places}f}"


def _percent(value: float) -> str:
    return "" if math.isnan(value) else f"{100.0 * value:.2f} %"

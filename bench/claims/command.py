"""``bench claims``: judge, show, write."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from algorithms import atomic
from bench.claims import rules
from bench.claims.evidence import TABLE_OF, Evidence
from bench.claims.verdict import Claim, Part
from bench.records import Collection
from bench.selection import tried
from bench.statistics import Interval
from bench.text import json_text

Rule = Callable[[Evidence, str], list[Part]]

CLAIMS: Final[dict[str, tuple[str, str, Rule]]] = {
    "C1": ("no collision in training or application, in scenarios a and b", "collision rate", rules.zero_collisions),
    "C2": ("faster than every fixed T_c, in training and application", "m/s", rules.faster),
    "C3": (
        "in training the guard intervenes at most half as often as with the best fixed T_c",
        "ratio of intervention ratios",
        rules.half_the_interventions,
    ),
    "C4": (
        "every baseline without a guard collides far more often",
        "difference of collision rates",
        rules.unguarded_collide,
    ),
    "C5": (
        "after 100,000 training steps the return is above that of every baseline",
        "difference of returns",
        rules.higher_return,
    ),
}
"""Statement, unit of the effect, and rule."""
PAPER_METHOD: Final = "dd-rq"
PLUS_METHOD: Final = "dd-rq-plus"


def judge(collection: Collection) -> list[Claim]:
    """C1 to C5 for the paper's method, and C1' to C5' for DD-RQ-plus where it has been run.

    Raises:
        RecordError: A record cannot be used.
    """
    evidence = Evidence(collection)
    claims = [_claim(evidence, name, name, PAPER_METHOD) for name in CLAIMS]
    if any(tried(collection, scenario, PLUS_METHOD) for scenario in TABLE_OF):
        claims += [_claim(evidence, name, f"{name}'", PLUS_METHOD) for name in CLAIMS]
    return claims


def _claim(evidence: Evidence, rule: str, name: str, method: str) -> Claim:
    statement, unit, parts = CLAIMS[rule]
    return Claim(name, method, statement, unit, tuple(parts(evidence, method)))


def write(results: Path, claims: Sequence[Claim]) -> Path:
    """Write ``claims.json`` and ``claims.md``, give the first; the same records give the same bytes."""
    path = results / "claims.json"
    results.mkdir(parents=True, exist_ok=True)
    atomic.write_file(path, (json_text(as_values(claims)) + "\n").encode())
    atomic.write_file(results / "claims.md", as_markdown(claims).encode())
    return path


def as_values(claims: Sequence[Claim]) -> list[dict[str, Any]]:
    """Plain values: numbers with six significant digits, None where there is none."""
    return [
        {
            "claim": claim.name,
            "method": claim.method,
            "statement": claim.statement,
            "verdict": str(claim.verdict),
            "effect": _number(claim.deciding.effect),
            "interval": _bounds(claim.deciding.interval),
            "unit": claim.unit,
            "n": sum(group.episodes for group in claim.groups),
            "deciding": claim.deciding.name,
            "reason": claim.reason,
            "parts": [_part_values(part) for part in claim.parts],
            "records": sorted({record.path.name for group in claim.groups for record in group.records}),
        }
        for claim in claims
    ]


def _part_values(part: Part) -> dict[str, Any]:
    return {
        "part": part.name,
        "verdict": str(part.verdict),
        "effect": _number(part.effect),
        "interval": _bounds(part.interval),
        "n": sum(group.episodes for group in part.groups),
        "seeds": [len(group.records) for group in part.groups],
        "paper": _number(part.paper),
        "reason": "; ".join(part.lacks) or part.reason,
        "records": [record.path.name for group in part.groups for record in group.records],
    }


def _number(value: float) -> float | None:
    return None if math.isnan(value) else float(f"{value:.6g}")


def _bounds(interval: Interval) -> list[float | None] | None:
    return None if interval.empty else [_number(interval.low), _number(interval.high)]


def as_markdown(claims: Sequence[Claim]) -> str:
    """One row for each claim, with what decided."""
    lines = ["# Claims", "", "| claim | method | statement | verdict | what decided |", "|---|---|---|---|---|"]
    for claim in claims:
        cells = (claim.name, claim.method, claim.statement, str(claim.verdict), claim.reason)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def as_text(claims: Sequence[Claim]) -> str:
    """Each claim with its verdict, what decided, and every comparison behind it."""
    blocks = []
    for claim in claims:
        n = sum(group.episodes for group in claim.groups)
        lines = [
            f"{claim.name} {claim.method}: {claim.statement}",
            f"   {str(claim.verdict).upper()}, n = {n:,} episodes",
            *textwrap.wrap(claim.reason, 116, initial_indent="   ", subsequent_indent="   "),
        ]
        lines += [f"     {part.name:44} {part.text:40} {part.verdict}" for part in claim.parts]
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks)

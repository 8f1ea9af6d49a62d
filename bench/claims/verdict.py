"""What can be said about a claim, and how its parts decide on it."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

from bench.claims.evidence import Group
from bench.statistics import Interval


class Verdict(enum.StrEnum):
    """What our records say about a claim."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    UNDECIDED = "undecided"


@dataclass(frozen=True, slots=True)
class Part:
    """One comparison within a claim; the claim holds only if every part does.

    Attributes:
        name: What is compared.
        verdict: Of this part.
        effect: In the claim's unit; NaN where nothing can be said.
        interval: 95 % interval of the effect.
        margin: How far the effect is on the claim's side; the part with the least one stands for the claim.
        text: Effect and interval for people.
        groups: The runs behind it.
        reason: What decided.
        lacks: What is missing for a verdict.
        paper: The same effect in the paper's figures, NaN where it prints none.
    """

    name: str
    verdict: Verdict
    effect: float
    interval: Interval
    margin: float
    text: str
    groups: tuple[Group, ...]
    reason: str
    lacks: tuple[str, ...]
    paper: float = math.nan


@dataclass(frozen=True, slots=True)
class Claim:
    """One claim about one method.

    Attributes:
        name: ``C1`` to ``C5``, with a prime for DD-RQ-plus, of which the paper claims nothing.
        method: That it is tested for.
        statement: The claim in one sentence.
        unit: Of the effect.
        parts: The comparisons.
    """

    name: str
    method: str
    statement: str
    unit: str
    parts: tuple[Part, ...]

    @property
    def verdict(self) -> Verdict:
        """Reproduced if all parts are, not reproduced if one is not, else undecided."""
        found = {part.verdict for part in self.parts}
        if Verdict.NOT_REPRODUCED in found:
            return Verdict.NOT_REPRODUCED
        return Verdict.UNDECIDED if Verdict.UNDECIDED in found else Verdict.REPRODUCED

    @property
    def deciding(self) -> Part:
        """Of the parts with the claim's verdict the one with the least margin; a part without runs only if all are."""
        verdict = self.verdict
        decided = [part for part in self.parts if part.verdict is verdict]
        return min(decided, key=lambda part: math.inf if math.isnan(part.margin) else part.margin)

    @property
    def groups(self) -> list[Group]:
        """Every set of runs behind it, once."""
        found = {group.key: group for part in self.parts for group in part.groups}
        return list(found.values())

    @property
    def reason(self) -> str:
        """What decided; for an undecided claim all that is missing, or what leaves it open."""
        if self.verdict is not Verdict.UNDECIDED:
            return self.deciding.reason
        undecided = [part for part in self.parts if part.verdict is Verdict.UNDECIDED]
        lacks = dict.fromkeys(lack for part in undecided for lack in part.lacks)
        unclear = [part.reason for part in undecided if not part.lacks]
        return "; ".join([*lacks, *unclear])


def shortfall(groups: Sequence[Group], seeds: int, episodes: int) -> tuple[str, ...]:
    """What is missing for a verdict, one line each.

    Args:
        groups: The runs that are compared.
        seeds: Least number for each.
        episodes: Least number for each, all seeds together.
    """
    lacks = []
    for group in groups:
        if not group.records:
            lacks.append(f"{group.method} on {group.scenario}: {group.missing}")
        elif len(group.records) < seeds:
            lacks.append(f"{group.method} on {group.scenario}: {len(group.records)} of at least {seeds} seeds")
        elif group.episodes < episodes:
            lacks.append(f"{group.label}: {group.episodes:,} of at least {episodes:,} episodes")
    return tuple(lacks)

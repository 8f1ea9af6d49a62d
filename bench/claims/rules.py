"""The rule of each claim. ``docs/claims.md`` says the same for people; change both."""

from __future__ import annotations

import dataclasses
import functools
from typing import Final

from bench.claims.comparing import (
    LEVEL,
    SEEDS_MIN,
    compared,
    empty_part,
    in_text,
    paired,
    rates_apart,
)
from bench.claims.evidence import Evidence, Group, return_after
from bench.claims.verdict import Part, Verdict, shortfall
from bench.statistics import (
    episodes_for_zero_claim,
    format_rate,
    mean_difference,
    mean_ratio,
)
from bench.summary import collision_rate

HALF: Final = 0.5
FAR_MORE: Final = 0.10
"""Difference in collision rate that counts as far more; the paper's smallest is 0.275."""
AFTER_STEPS: Final = 100_000
WINDOW_STEPS: Final = 50_000
UNGUARDED: Final = ("sac", "cpo", "focops", "trpo-lag")


def zero_collisions(evidence: Evidence, method: str) -> list[Part]:
    """C1: none in training or application, in either scenario."""
    return [_zero_part(evidence, scenario, method, stage) for scenario in "ab" for stage in "TA"]


def _zero_part(evidence: Evidence, scenario: str, method: str, stage: str) -> Part:
    group = evidence.group(scenario, method, stage)
    paper = evidence.paper(scenario, "dd-rq", stage, "collision_rate") / 100.0
    rate = collision_rate(group.counts, LEVEL)
    if not rate.trials:
        return empty_part(group.label, [group], paper)
    needed = episodes_for_zero_claim(least_told_from_zero(evidence))
    lacks = shortfall([group], SEEDS_MIN, needed)
    if not lacks and rate.independent < needed:
        lacks = (f"{group.label}: {rate.independent:,} of at least {needed:,} distinct episodes",)
    if rate.events:
        verdict, reason = Verdict.NOT_REPRODUCED, f"{group.label}: {rate.events} collisions in {rate.trials} episodes"
    else:
        verdict = Verdict.UNDECIDED if lacks else Verdict.REPRODUCED
        reason = f"{group.label}: no collision in {rate.trials} episodes"
    interval, text = rate.stated, format_rate(rate.rate)
    return Part(group.label, verdict, rate.value, interval, -interval.high, text, (group,), reason, lacks, paper)


def least_told_from_zero(evidence: Evidence) -> float:
    """The least collision rate above zero that the paper prints: what a zero must be told from."""
    rates = [
        evidence.paper(scenario, method, stage, "collision_rate")
        for scenario in "ab"
        for stage in "TA"
        for name in ("dd-rq", "safety-guard", *UNGUARDED)
        for method in evidence.methods(scenario, name)
    ]
    return min(rate for rate in rates if rate > 0.0) / 100.0


def faster(evidence: Evidence, method: str) -> list[Part]:
    """C2: a higher mean speed than every fixed T_c, in training and application on a."""
    guards = [(guard, stage) for stage in "TA" for guard in evidence.methods("a", "safety-guard")]
    parts = []
    for guard, stage in guards:
        ours, theirs = evidence.group("a", method, stage), evidence.group("a", guard, stage)
        first, second = (group.values(lambda c: c.speed_mps) for group in (ours, theirs))
        paper = _paper_difference(evidence, guard, stage)
        parts.append(
            compared(
                f"minus {guard} on a, {stage}",
                [ours, theirs],
                functools.partial(mean_difference, first, second),
                bound=0.0,
                tests=len(guards),
                show=lambda e: in_text("+.2f", e, unit="m/s"),
                paper=paper,
            )
        )
    return parts


def _paper_difference(evidence: Evidence, other: str, stage: str) -> float:
    ours, theirs = (evidence.paper("a", name, stage, "speed_mps") for name in ("dd-rq", other))
    return ours - theirs


def half_the_interventions(evidence: Evidence, method: str) -> list[Part]:
    """C3: in training on a at most half the intervention ratio of every fixed T_c, so of the best."""
    guards = evidence.methods("a", "safety-guard")
    parts = []
    for guard in guards:
        ours, theirs = evidence.group("a", method, "T"), evidence.group("a", guard, "T")
        first, second = (group.values(lambda c: c.intervention_ratio) for group in (ours, theirs))
        figures = [evidence.paper("a", name, "T", "intervention_ratio") for name in ("dd-rq", guard)]
        parts.append(
            compared(
                f"over {guard} on a, T",
                [ours, theirs],
                functools.partial(mean_ratio, first, second),
                bound=HALF,
                tests=len(guards),
                show=lambda e: in_text(".2f", e),
                paper=figures[0] / figures[1],
                below=True,
            )
        )
    return parts


def unguarded_collide(evidence: Evidence, method: str) -> list[Part]:
    """C4: each baseline without a guard collides more often, by at least 10 points of all episodes."""
    pairs = [
        (scenario, baseline, stage)
        for scenario in "ab"
        for stage in "TA"
        for name in UNGUARDED
        for baseline in evidence.methods(scenario, name)
    ]
    parts = []
    for scenario, baseline, stage in pairs:
        theirs, ours = evidence.group(scenario, baseline, stage), evidence.group(scenario, method, stage)
        figures = [evidence.paper(scenario, name, stage, "collision_rate") for name in (baseline, "dd-rq")]
        parts.append(
            compared(
                f"{baseline} minus ours on {scenario}, {stage}",
                [ours, theirs],
                functools.partial(rates_apart, theirs, ours),
                bound=FAR_MORE,
                tests=len(pairs),
                show=lambda e: in_text("+.1f", e, 100.0, "points"),
                paper=(figures[0] - figures[1]) / 100.0,
            )
        )
    return paired(parts)


def higher_return(evidence: Evidence, method: str) -> list[Part]:
    """C5: after 100,000 steps of training on b a higher mean return without r_risk than every baseline."""
    baselines = [b for name in ("safety-guard", *UNGUARDED) for b in evidence.methods("b", name)]
    parts = []
    for baseline in baselines:
        ours, theirs = (_later(evidence.group("b", name, "T")) for name in (method, baseline))
        first, second = (
            [return_after(record, AFTER_STEPS, WINDOW_STEPS)[0] for record in group.records] for group in (ours, theirs)
        )
        parts.append(
            compared(
                f"minus {baseline} on b, T",
                [ours, theirs],
                functools.partial(mean_difference, first, second),
                bound=0.0,
                tests=len(baselines),
                show=lambda e: in_text("+.1f", e),
            )
        )
    return parts


def _later(group: Group) -> Group:
    """Only the seeds that have episodes after 100,000 steps, and only these episodes."""
    ends = [return_after(record, AFTER_STEPS, WINDOW_STEPS)[1] for record in group.records]
    kept = [i for i, episodes in enumerate(ends) if episodes]
    missing = group.missing or ("" if kept else f"no episode after {AFTER_STEPS:,} training steps")
    return dataclasses.replace(
        group,
        records=tuple(group.records[i] for i in kept),
        counts=tuple(group.counts[i] for i in kept),
        episodes=sum(ends),
        missing=missing,
    )

"""Episodes that the report can play: a few of each run with a policy, and pairs that show a guard at work.

They are driven once for each record and kept in the cache; a record never changes, so neither does what is kept.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from algorithms.artefacts import cached, digest
from bench import store
from bench.errors import BenchError
from bench.records import Record
from bench.replay.choice import CLOSEST, WORST, choose_episode
from bench.replay.held_out import replay
from bench.replay.packed import packed_text
from bench.schema import column
from envs.world import Ending

FORMAT: Final = 1
"""Raised by every change of what is kept."""
PAIRS: Final = (("sac", "dd-rq"), ("sac", "safety-guard"), ("cruise", "cruise+guard"), ("random", "random+guard"))
"""Unguarded and guarded drivers; the first pair that ran on a scenario is shown for it."""


@dataclass(frozen=True, slots=True)
class Pair:
    """Two runs on the same episode: one in which the first driver came to grief.

    Attributes:
        first: Without a guard.
        second: Behind one.
        episode: Number in the held-out list of both.
    """

    first: Record
    second: Record
    episode: int


def chosen(record: Record) -> dict[int, str]:
    """Episodes of a record worth a look, in words by number: the first, a collision, the closest call."""
    episodes = record.eval_episodes()
    found = {0: "first of the list"}
    if (column(episodes, "ending") == Ending.COLLISION).any():
        found.setdefault(choose_episode(episodes, WORST), "first collision")
    if not (column(episodes, "ending") == Ending.COLLISION).all():
        found.setdefault(choose_episode(episodes, CLOSEST), "closest call")
    return found


def pairs(records: Sequence[Record]) -> list[Pair]:
    """One pair for each scenario where both of some `PAIRS` left a policy of one seed; the longest trained."""
    able = {
        (r.spec.scenario_id, r.spec.method, r.spec.seed): r
        for r in sorted(records, key=lambda record: record.spec.steps)
        if has_policy(r) and not r.spec.settings
    }
    found: list[Pair] = []
    for scenario, seed in sorted({(scenario, seed) for scenario, _, seed in able}):
        both = [(able.get((scenario, a, seed)), able.get((scenario, b, seed))) for a, b in PAIRS]
        ready = [(a, b) for a, b in both if a is not None and b is not None]
        if ready and all(pair.first.spec.scenario_id != scenario for pair in found):
            first, second = ready[0]
            number = choose_episode(first.eval_episodes(), WORST)
            if number < second.spec.eval_episodes:
                found.append(Pair(first, second, number))
    return found


def has_policy(record: Record) -> bool:
    """Whether a record kept its policy."""
    return (record.path / store.POLICY_FOLDER).is_dir()


def play(record: Record, numbers: Sequence[int], cache: Path) -> dict[str, Any]:
    """Episodes of a record, compressed, by number; ``reason`` where they cannot be shown.

    Args:
        record: Whose policy drives.
        numbers: Of held-out episodes.
        cache: Where what was driven is kept.
    """
    if not has_policy(record):
        return {"episodes": {}, "reason": "This record keeps no policy; seed 0 of the method may."}
    # Failures are not kept: another version of the project, or another processor, may do better.
    key = {"run": record.spec.hash, "files": record.seals, "numbers": sorted(numbers), "format": FORMAT}
    try:
        folder = cached(cache / "replays" / digest(key), lambda path: _drive(record, sorted(numbers), path))
    except BenchError as error:
        return {"episodes": {}, "reason": str(error)}
    return {"episodes": json.loads((folder / "episodes.json").read_text()), "reason": ""}


def _drive(record: Record, numbers: Sequence[int], folder: Path) -> None:
    shown = {one.trace.number: packed_text([one]) for one in replay(record, numbers)}
    (folder / "episodes.json").write_text(json.dumps(shown))


def collect_episodes(
    records: Sequence[Record], cache: Path, progress: Callable[[str], None] = lambda _label: None
) -> dict[str, Any]:
    """All that the report plays.

    Args:
        records: Finished runs.
        cache: Where what was driven is kept.
        progress: Called with the label of each run before it is driven.

    Returns:
        ``runs``: for each folder name its episodes (``number``, ``why``, ``data``) and ``reason``;
        ``pairs``: for each pair ``scenario``, ``first``, ``second``, ``number``.
    """
    shown_pairs = pairs(records)
    wanted = {record.path.name: chosen(record) if has_policy(record) else {} for record in records}
    for pair in shown_pairs:
        for record, why in ((pair.first, "without a guard"), (pair.second, "with a guard")):
            wanted[record.path.name].setdefault(pair.episode, f"compared: {why}")
    runs = {}
    for record in records:
        progress(record.spec.label)
        names = wanted[record.path.name]
        kept = play(record, list(names), cache)
        runs[record.path.name] = {
            "episodes": [
                {"number": int(number), "why": names[int(number)], "data": data}
                for number, data in sorted(kept["episodes"].items(), key=lambda item: int(item[0]))
            ],
            "reason": kept["reason"],
        }
    return {"runs": runs, "pairs": [_pair_values(pair) for pair in shown_pairs]}


def _pair_values(pair: Pair) -> dict[str, Any]:
    return {
        "scenario": pair.first.spec.scenario_id,
        "first": pair.first.path.name,
        "second": pair.second.path.name,
        "number": pair.episode,
    }

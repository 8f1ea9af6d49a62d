"""``bench replay``: what is typed, to replays, to a file or a summary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from bench.errors import UsageError
from bench.records import Record, find_record
from bench.replay import held_out
from bench.replay.choice import choose_episode
from bench.replay.held_out import Replay
from bench.replay.packed import packed
from bench.replay.stressed import PREFIX, parse_name, replay_named
from bench.spec import RunSpec

SUFFIXES: Final = (".mp4", ".gif", ".png", ".html")
_SHOWN: Final = ("title", "scenario", "episode", "exact", "steps", "ending", "fault")


def replays(run: str, episode: str, against: str | None, results: Path) -> list[Replay]:
    """The episode of a run, and the same episode of another one where that is asked for.

    Args:
        run: Part of a run's folder name, or ``stress:...``.
        episode: Its number, or for a record ``worst`` or ``closest``.
        against: The same for a second method, or None.
        results: The results folder.

    Raises:
        UsageError: A name is unknown, or the two do not share their list of episodes.
    """
    names = [run] if against is None else [run, against]
    stressed = [name.startswith(PREFIX) for name in names]
    if any(stressed):
        if not all(stressed):
            raise UsageError(f"{run} --against {against}: a stress test and a record share no episodes.")
        return _stressed(names, episode, results)
    records = [find_record(results, name) for name in names]
    if len(records) == 2:
        _require_same_list(records[0].spec, records[1].spec)
    number = choose_episode(records[0].eval_episodes(), episode)
    return [found for record in records for found in held_out.replay(record, [_held_out(record, number)])]


def _held_out(record: Record, number: int) -> int:
    if number >= record.spec.eval_episodes:
        raise UsageError(
            f"{record.path.name} has held-out episodes 0 to {record.spec.eval_episodes - 1}, not {number}."
        )
    return number


def _require_same_list(first: RunSpec, second: RunSpec) -> None:
    if first.scenario_id != second.scenario_id:
        raise UsageError(f"{first.label} and {second.label} share no episodes: compare runs on the same scenario.")


def _stressed(names: Sequence[str], episode: str, results: Path) -> list[Replay]:
    if not episode.isdecimal():
        raise UsageError(
            f"--episode {episode}: a stress test's episode has a number; bench stress guard prints those under worst."
        )
    tests = [parse_name(name) for name in names]
    if len({(test.scenario.id, test.seed) for test in tests}) > 1:
        raise UsageError(f"{' and '.join(names)} share no episodes: compare tests of the same scenario and seed.")
    return [found for test in tests for found in replay_named(test, [int(episode)], results / "cache")]


def check_suffix(out: Path) -> None:
    """Refuse a file that cannot be written, before anything is driven.

    Raises:
        UsageError: The suffix is unknown, or the folder is not there.
    """
    if out.suffix not in SUFFIXES:
        raise UsageError(f"--out {out}: the suffix must be one of {', '.join(SUFFIXES)}.")
    if not out.absolute().parent.is_dir():
        raise UsageError(f"--out {out}: there is no folder {out.absolute().parent}.")


def write(shown: Sequence[Replay], out: Path) -> str:
    """Write a film, a sheet of moments or a page; says what was written."""
    from bench.replay import draw, page

    writers: Mapping[str, tuple[Callable[[Sequence[Replay], Path], int], str]] = {
        ".mp4": (draw.write_moving, "pictures"),
        ".gif": (draw.write_moving, "pictures"),
        ".png": (draw.write_picture, "moments"),
        ".html": (page.write_page, "episodes side by side" if len(shown) > 1 else "episode"),
    }
    writer, what = writers[out.suffix]
    return f"{out}: {writer(shown, out)} {what}"


def as_values(shown: Sequence[Replay]) -> list[dict[str, Any]]:
    """What happened in each replay, for a program."""
    contents = [packed(replay) for replay in shown]
    return [{**{name: content[name] for name in _SHOWN}, **content["figures"]} for content in contents]


def as_text(shown: Sequence[Replay]) -> str:
    """What happened in each replay, for people."""
    blocks = []
    for values in as_values(shown):
        exact = values.pop("exact")
        checked = "every figure the same" if exact else "to rounding: this processor's is not the record's"
        lines = [f"{values.pop('title')}", f"  {'replayed':22} {checked}"]
        lines += [f"  {name:22} {'none' if value is None else value}" for name, value in values.items()]
        blocks.append("\n".join(lines))
    return "\n".join(blocks)

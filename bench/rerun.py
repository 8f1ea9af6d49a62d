"""``bench rerun``: repeat a finished run and compare the bytes of its record."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa

from algorithms.registry import get_method
from bench import schema, store, sweep
from bench.display import choose_display
from bench.errors import RunFailedError, UsageError
from bench.executors import LocalExecutor
from bench.progress import Phase
from bench.provenance import provenance
from bench.records import Record, read_record
from bench.spec import RunSpec
from bench.store import Store


def other_code(record: Record) -> list[str]:
    """What this code and its packages do not share with those that made the record, one line each."""
    then, now = record.details.get("provenance", {}), provenance()
    notes = []
    if then.get("source_sha256") != now["source_sha256"]:
        git = then.get("git", {})
        dirty = " with changes" if git.get("dirty") else ""
        notes.append(f"the record was made by commit {git.get('commit') or 'unknown'}{dirty}; the sources here differ")
    before, here = then.get("packages", {}), now["packages"]
    for name in sorted(before.keys() | here.keys()):
        if before.get(name) != here.get(name):
            notes.append(f"{name} was {before.get(name, 'not listed')}, is {here.get(name, 'not installed')}")
    notes += [f"{key} was {then.get(key)}, is {now[key]}" for key in ("python", "cpu") if then.get(key) != now[key]]
    return notes


def repeat(record: Record, results: Path, quiet: bool) -> list[str]:
    """Run a record's specification again, with the same cache, and name what differs.

    Raises:
        UsageError: The method's results have another version by now, or the results folder cannot be written.
        RecordError: A file of the record is missing or was changed.
        RunFailedError: The run failed this time.
    """
    version = get_method(record.spec.method).version
    if version != record.spec.method_version:
        raise UsageError(
            f"{record.path.name} is of version {record.spec.method_version} of {record.spec.method}, this is version "
            f"{version}: check out the commit that its run.json names."
        )
    for name in record.seals:  # here as well as afterwards: a run may take hours
        _seal(record, name)
    cache = Store(results).cache
    try:
        cache.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"--results {results}: {cache}, where runs share what they train, cannot be made ({error.strerror}): "
            "make the folder writable, or give another one."
        ) from error
    with tempfile.TemporaryDirectory(prefix="rerun-") as scratch:
        folder = Path(scratch)
        os.symlink(cache.resolve(), folder / "cache")
        return list(differences(record, _run(record.spec, folder, quiet)))


def _run(spec: RunSpec, folder: Path, quiet: bool) -> Record:
    board = sweep.plan([spec], folder, workers=1)
    sweep.execute(board, LocalExecutor(folder, 1), choose_display(board, quiet))
    (run,) = board.runs
    if run.phase is not Phase.DONE:
        raise RunFailedError(f"{spec.label}: {run.reason}")
    return read_record(Store(folder).folder(spec))


def differences(record: Record, again: Record) -> Iterator[str]:
    """One line for each file that has other bytes; ``run.json`` tells of time and machine and is left out."""
    for name in sorted((record.seals.keys() | again.seals.keys()) - {store.RUN_FILE}):
        if name not in again.seals or name not in record.seals:
            yield f"{name}: only in the {'record' if name in record.seals else 'repetition'}"
        elif _seal(record, name) != again.seals[name]:
            yield f"{name}: {_how(name, record, again)}"


def _seal(record: Record, name: str) -> str:
    """What a file was sealed as, and still is; only a policy may be absent: most are not published."""
    if Path(name).parts[0] != store.POLICY_FOLDER or (record.path / name).exists():
        record.sealed(name)
    return record.seals[name]


def _how(name: str, record: Record, again: Record) -> str:
    tables = {
        store.TRAIN_FILE: Record.train_episodes,
        store.EVAL_FILE: Record.eval_episodes,
        store.SCALARS_FILE: Record.scalars,
    }
    if name not in tables:
        return "other bytes"
    one, two = tables[name](record), tables[name](again)
    if one.num_rows != two.num_rows:
        return f"{one.num_rows} rows, then {two.num_rows}"
    changed = [column for column in one.column_names if not _same(one, two, column)]
    return f"{one.num_rows} rows, other values of {', '.join(changed)}" if changed else "same values, other bytes"


def _same(one: pa.Table, two: pa.Table, column: str) -> bool:
    return bool(schema.column(one, column).tobytes() == schema.column(two, column).tobytes())


def as_values(found: list[str]) -> dict[str, Any]:
    """For ``--json``."""
    return {"identical": not found, "differences": found}


def as_text(record: Record, found: list[str]) -> str:
    """For people."""
    if not found:
        return f"{record.path.name}: identical, {len(record.seals) - 1} files."
    return "\n".join([f"{record.path.name}: not identical", *(f"  {line}" for line in found)])

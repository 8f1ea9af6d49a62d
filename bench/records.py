"""Finished records: read, verified against their seals, refused by name where anything is wrong."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
from pydantic import ValidationError

from bench import schema, store
from bench.errors import RecordError, UsageError
from bench.lock import LOCK_NAME
from bench.spec import RunSpec
from bench.store import Failure, State, Store

LISTED: Final = 8
"""Folders that a message names at most."""


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """One finished run; equal only to itself, so that what is computed from it can be kept.

    Attributes:
        path: Its folder.
        spec: What was run.
        details: ``run.json`` without the specification: provenance, timing, timeline.
        seals: SHA-256 by file, as ``DONE`` states.
    """

    path: Path
    spec: RunSpec
    details: dict[str, Any]
    seals: dict[str, str]

    def train_episodes(self) -> pa.Table:
        """Completed training episodes, in order of completion."""
        return self._table(store.TRAIN_FILE, schema.EPISODES)

    def eval_episodes(self) -> pa.Table:
        """Held-out episodes, in order of number."""
        return self._table(store.EVAL_FILE, schema.EPISODES)

    def scalars(self) -> pa.Table:
        """What the learner reported."""
        return self._table(store.SCALARS_FILE, schema.SCALARS)

    def _table(self, name: str, expected: pa.Schema) -> pa.Table:
        return schema.from_bytes(self.sealed(name), expected, f"{self.path.name}/{name}")

    def sealed(self, name: str) -> bytes:
        """A file's content.

        Raises:
            RecordError: It is missing, or not what was sealed.
        """
        where = f"{self.path.name}/{name}"
        try:
            content = (self.path / name).read_bytes()
        except OSError as error:
            raise RecordError(f"{where} cannot be read: remove the folder and run it again.") from error
        if hashlib.sha256(content).hexdigest() != self.seals.get(name):
            raise RecordError(
                f"{where} is not what was sealed (truncated or changed): remove the folder and run it again."
            )
        return content


@dataclass(frozen=True, slots=True)
class Missing:
    """A run without a finished record: failed, interrupted or still at work."""

    spec: RunSpec
    state: State
    failure: Failure | None

    @property
    def reason(self) -> str:
        """One line for a table's cell."""
        if self.failure is not None:
            return f"failed at step {self.failure.step} ({self.failure.stage}): {self.failure.reason}"
        return str(self.state)


@dataclass(frozen=True, slots=True)
class Collection:
    """What a results folder holds."""

    records: tuple[Record, ...]
    missing: tuple[Missing, ...]


def read_record(path: Path) -> Record:
    """The finished record of a folder.

    Raises:
        RecordError: It is truncated, foreign, or of another version.
    """
    spec, details = _read_run(path)
    done = store.read_json(path / store.DONE_FILE)
    seals = done.get("files")
    if done.get("hash") != spec.hash or not isinstance(seals, dict):
        raise RecordError(f"{path.name}/DONE belongs to another run: remove the folder and run it again.")
    record = Record(path, spec, details, seals)
    record.sealed(store.RUN_FILE)
    return record


def find_record(results: Path, text: str) -> Record:
    """The finished record that a text names: its folder, or any part of the folder's name that no other has.

    Raises:
        UsageError: No run, several, or one without a finished record has such a name.
        RecordError: The record cannot be used.
    """
    if (Path(text) / store.DONE_FILE).exists():
        return read_record(Path(text).resolve())
    folders = Store(results).folders()
    name = Path(text).name
    found = [path for path in folders if path.name == name] or [path for path in folders if text in path.name]
    if not found:
        raise UsageError(
            f"run {text!r}: {results / 'runs'} has no folder with this in its name; it has {len(folders)}."
        )
    if len(found) > 1:
        names = "".join(f"\n  {path.name}" for path in found[:LISTED])
        more = f"\n  and {len(found) - LISTED} more" if len(found) > LISTED else ""
        raise UsageError(f"run {text!r} fits {len(found)} runs; type more of the name of one:{names}{more}")
    state = store.folder_state(found[0])
    if state is not State.DONE:
        raise UsageError(f"run {found[0].name} is {state}: only a finished run has a record.")
    return read_record(found[0])


def _read_run(path: Path) -> tuple[RunSpec, dict[str, Any]]:
    content = store.read_json(path / store.RUN_FILE)
    if content.pop("format", None) != store.FORMAT:
        raise RecordError(f"{path.name} is not a record of this project: move the folder away.")
    version = content.pop("record_version", None)
    if version != store.RECORD_VERSION:
        raise RecordError(
            f"{path.name} is a record of version {version}, this project reads {store.RECORD_VERSION}: "
            "run it again, or use the version of the project that wrote it."
        )
    stated = content.pop("hash", None)
    try:
        spec = RunSpec.model_validate(content.pop("spec", None))
    except ValidationError as error:
        raise RecordError(f"{path.name}: its specification is not valid: move the folder away.") from error
    if stated != spec.hash:
        raise RecordError(f"{path.name}: its specification was changed afterwards: remove it and run it again.")
    if path.name != spec.folder_name:
        raise RecordError(
            f"{path.name} is a copy of {spec.folder_name} under another name: remove the copy, "
            "or the run would count twice."
        )
    return spec, content


def collect_existing(results: Path) -> Collection:
    """All runs of a results folder that must be there, for commands that write what they draw from it.

    Raises:
        UsageError: It is not there, or has no runs: a mistyped name must not overwrite tables by empty ones.
        RecordError: As `collect`.
    """
    if not Store(results).folders():
        raise UsageError(f"--results {results}: no runs there; bench run makes some, or give another folder.")
    return collect(results)


def collect(results: Path, known: Iterable[Record] = ()) -> Collection:
    """All runs of a results folder.

    Args:
        results: The folder.
        known: Records that have been read before, and are not read again.

    Raises:
        RecordError: Some cannot be used; the message names each of them with the remedy.
    """
    collection, errors = collect_readable(results, known)
    errors += mixed_versions(collection.records)
    if errors:
        raise RecordError("\n".join(errors))
    return collection


def collect_readable(results: Path, known: Iterable[Record] = ()) -> tuple[Collection, list[str]]:
    """The runs of a results folder that can be read, of whatever versions, and a line for each that cannot."""
    read = {record.path: record for record in known}
    records: list[Record] = []
    missing: list[Missing] = []
    errors: list[str] = []
    for path in Store(results).folders():
        try:
            state = store.folder_state(path)
            if state is State.DONE:
                records.append(read.get(path) or read_record(path))
            elif (path / store.RUN_FILE).exists() or not _only_leftovers(path):
                missing.append(Missing(_read_run(path)[0], state, store.read_failure(path)))
        except RecordError as error:
            errors.append(str(error))
    return Collection(tuple(records), tuple(missing)), errors


def _only_leftovers(path: Path) -> bool:
    """Whether a folder holds nothing but what a killed process may leave before it wrote ``run.json``."""
    return all(entry.name == LOCK_NAME or entry.name.startswith(".") for entry in path.iterdir())


def mixed_versions(records: Iterable[Record]) -> list[str]:
    """A complaint for each method or scenario of which several versions are present."""
    versions: dict[tuple[str, str], dict[int, list[str]]] = {}
    for record in records:
        spec = record.spec
        method = ("method", spec.method.partition(":")[0])
        for key, version in (
            (method, spec.method_version),
            (("scenario", spec.scenario), spec.scenario_version),
        ):
            versions.setdefault(key, {}).setdefault(version, []).append(record.path.name)
    return [
        f"{kind} {name}: records of versions {' and '.join(map(str, sorted(found)))} never share a table; "
        f"move the older away: {_some(found[min(found)])}."
        for (kind, name), found in sorted(versions.items())
        if len(found) > 1
    ]


def _some(names: Sequence[str], at_most: int = 5) -> str:
    more = f" and {len(names) - at_most} more" if len(names) > at_most else ""
    return ", ".join(names[:at_most]) + more

"""Records on disk: layout and states.

DIR/runs/<folder>/run.json                what was run, by which code, on what, for how long
                  train_episodes.parquet  stage T, see `bench.schema`
                  eval_episodes.parquet   stage A, on the held-out list
                  scalars.parquet         what the learner reported
                  policy/                 weights as safetensors, the rest as JSON
                  DONE                    written last: SHA-256 of every other file
                  FAILED                  instead of DONE: stage, step, reason, traceback
                  LOCK                    while a process works on the run
                  checkpoints/            of a training that goes on, or was killed
                  TRAINED                 from the end of training to DONE: what run.json will say of it
"""

from __future__ import annotations

import contextlib
import enum
import hashlib
import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from algorithms import atomic
from bench.errors import AlreadyDoneError, LockedError, RecordError
from bench.lock import LOCK_NAME, RunLock, current_owner
from bench.spec import RunSpec

FORMAT: Final = "safedrive-bench run"
RECORD_VERSION: Final = 1
"""Raised by every change of the layout or of ``run.json``."""
RUN_FILE: Final = "run.json"
DONE_FILE: Final = "DONE"
FAILED_FILE: Final = "FAILED"
TRAIN_FILE: Final = "train_episodes.parquet"
EVAL_FILE: Final = "eval_episodes.parquet"
SCALARS_FILE: Final = "scalars.parquet"
POLICY_FOLDER: Final = "policy"
CHECKPOINT_FOLDER: Final = "checkpoints"
TRAINED_FILE: Final = "TRAINED"
_PASSING: Final = (LOCK_NAME, TRAINED_FILE)
"""Not part of a record."""


class State(enum.StrEnum):
    """Where a run stands."""

    ABSENT = "absent"
    RUNNING = "running"
    UNFINISHED = "unfinished"
    FAILED = "failed"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a run failed.

    Attributes:
        stage: ``setup``, ``train``, ``evaluate``, ``write`` or ``worker``.
        step: Simulation step of training at which it happened.
        reason: One line.
        traceback: For the curious, paths relative to the project.
    """

    stage: str
    step: int
    reason: str
    traceback: str = ""


class RunFolder:
    """The folder of a run that this process owns. Made by `Store.begin`."""

    def __init__(self, path: Path, spec: RunSpec, lock: RunLock) -> None:
        self.path = path
        self.spec = spec
        self.touch = lock.touch

    def write(self, name: str, content: bytes) -> None:
        """Write one file, whole or not at all."""
        atomic.write_file(self.path / name, content)

    def write_run(self, details: dict[str, Any]) -> None:
        """Write ``run.json`` with the specification and these details."""
        head = {"format": FORMAT, "record_version": RECORD_VERSION, "hash": self.spec.hash}
        self.write(RUN_FILE, to_json({**head, "spec": self.spec.model_dump(), **details}))

    def write_policy(self, save: Callable[[Path], None]) -> None:
        """Let a policy write itself into ``policy/``, whole or not at all."""
        atomic.write_folder(self.path / POLICY_FOLDER, save)

    @property
    def checkpoints(self) -> Path:
        """Folder for the checkpoints of a training."""
        return self.path / CHECKPOINT_FOLDER

    def mark_trained(self, identity: str, details: dict[str, Any]) -> None:
        """Keep what training left, for an attempt after this one; of the same identity, or it trains again."""
        content = {"identity": identity, "files": self._hashes(skip=RUN_FILE), "details": details}
        self.write(TRAINED_FILE, to_json(content))

    def trained(self, identity: str) -> dict[str, Any] | None:
        """The details that `mark_trained` was given, if all that training left is whole, else None."""
        try:
            content = read_json(self.path / TRAINED_FILE)
            whole = content["identity"] == identity and content["files"] == self._hashes(skip=RUN_FILE)
            details: dict[str, Any] | None = content["details"] if whole else None
        except (RecordError, OSError, KeyError):
            details = None
        if details is None:
            self.clear(keep=(RUN_FILE, CHECKPOINT_FOLDER))
        return details

    def _hashes(self, skip: str = "") -> dict[str, str]:
        """SHA-256 of every file of the record so far."""
        return {
            str(path.relative_to(self.path)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in atomic.files_below(self.path)
            if path.name not in (*_PASSING, skip) and self.checkpoints not in path.parents
        }

    def finish(self) -> None:
        """Seal the record: from here on nothing changes."""
        self.write(DONE_FILE, to_json({"hash": self.spec.hash, "files": self._hashes()}))
        self.discard_passing()

    def discard_passing(self) -> None:
        """Remove what only an unfinished run needs."""
        with contextlib.suppress(OSError):
            (self.path / TRAINED_FILE).unlink(missing_ok=True)
        shutil.rmtree(self.checkpoints, ignore_errors=True)

    def fail(self, failure: Failure) -> None:
        """Leave the reason of a failure; a sealed record stays as it is."""
        if (self.path / DONE_FILE).exists():
            return
        if not (self.path / RUN_FILE).exists():
            self.write_run({})
        content = {
            "method": self.spec.method, "stage": failure.stage, "step": failure.step, "reason": failure.reason,
        }  # fmt: skip
        self.write(FAILED_FILE, to_json({**content, "traceback": failure.traceback.splitlines()}))

    def clear(self, keep: Sequence[str] = ()) -> None:
        """Remove what an interrupted or failed attempt left, but for the named files and folders."""
        for path in self.path.iterdir():
            if path.name not in (LOCK_NAME, *keep):
                shutil.rmtree(path) if path.is_dir() else path.unlink()

    def keep_progress(self) -> None:
        """Remove all that the next attempt cannot go on from."""
        keep = [CHECKPOINT_FOLDER]
        if (self.path / TRAINED_FILE).exists():
            keep += [TRAINED_FILE, TRAIN_FILE, SCALARS_FILE, POLICY_FOLDER]
        self.clear(keep)


class Store:
    """All runs of a results folder."""

    def __init__(self, results: Path) -> None:
        self.results = results
        self.runs = results / "runs"
        self.cache = results / "cache"

    def folder(self, spec: RunSpec) -> Path:
        """Where the record of a run is, or will be."""
        return self.runs / spec.folder_name

    def state(self, spec: RunSpec) -> State:
        """Where a run stands, judged by the files that mark it."""
        return folder_state(self.folder(spec))

    @contextlib.contextmanager
    def begin(self, spec: RunSpec) -> Iterator[RunFolder]:
        """Own the folder of a run, emptied of all that cannot be gone on from.

        Raises:
            AlreadyDoneError: The run is done.
            LockedError: Another process works on it.
        """
        path = self.folder(spec)
        path.mkdir(parents=True, exist_ok=True)
        with RunLock(path) as lock:
            folder = RunFolder(path, spec, lock)
            if (path / DONE_FILE).exists():
                folder.discard_passing()
                raise AlreadyDoneError(f"{spec.folder_name} is done; remove its folder to run it again.")
            folder.keep_progress()
            yield folder

    def fail(self, spec: RunSpec, failure: Failure) -> None:
        """Mark a run as failed from outside, for a worker that died in it; a live owner is left alone."""
        path = self.folder(spec)
        path.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(LockedError), RunLock(path) as lock:
            RunFolder(path, spec, lock).fail(failure)

    def failure(self, spec: RunSpec) -> Failure | None:
        """Why a run failed, or None."""
        return read_failure(self.folder(spec))

    def folders(self) -> list[Path]:
        """Folders of all runs, in order of name."""
        if not self.runs.is_dir():
            return []
        return sorted(path for path in self.runs.iterdir() if path.is_dir() and not path.name.startswith("."))


def folder_state(path: Path) -> State:
    """Where the run of a folder stands."""
    if not path.is_dir():
        return State.ABSENT
    if (path / DONE_FILE).exists():
        return State.DONE
    if current_owner(path) is not None:
        return State.RUNNING
    return State.FAILED if (path / FAILED_FILE).exists() else State.UNFINISHED


def read_failure(path: Path) -> Failure | None:
    """The failure that a folder holds, or None."""
    if not (path / FAILED_FILE).exists():
        return None
    content = read_json(path / FAILED_FILE)
    try:
        return Failure(content["stage"], content["step"], content["reason"], "\n".join(content["traceback"]))
    except (KeyError, TypeError) as error:
        raise RecordError(f"{path.name}/{FAILED_FILE} is damaged: remove the folder and run it again.") from error


def to_json(content: dict[str, Any]) -> bytes:
    """JSON as the store writes it: sorted, indented, finite numbers only."""
    return (json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n").encode()


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object.

    Raises:
        RecordError: The file is missing, truncated or something else.
    """
    where = f"{path.parent.name}/{path.name}"
    try:
        content = json.loads(path.read_bytes())
    except FileNotFoundError as error:
        raise RecordError(f"{where} is missing: not a record of this project, move the folder away.") from error
    except (OSError, ValueError) as error:
        raise RecordError(f"{where} is truncated or damaged: remove the folder and run it again.") from error
    if not isinstance(content, dict):
        raise RecordError(f"{where} is not a record of this project: move the folder away.")
    return content

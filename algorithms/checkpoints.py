"""Checkpoints inside a training: whole or absent, the last two kept, read without executing code.

FOLDER/000012.npz       the state after the twelfth checkpoint, `State.arrays` and JSON in one file
       000012.rows.npz  rows that `State.growing` gained since the eleventh

A replay buffer or a list of episodes only ever gets longer, so each row is written once: the cost of a checkpoint
does not grow with the training.
"""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import sys
import time
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from algorithms import atomic

Array = npt.NDArray[Any]

FORMAT: Final = "safedrive-bench checkpoint 1"
EVERY_S: Final = 60.0
KEPT: Final = 2
_HEAD: Final = "//head"
_DAMAGE: Final = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile)


@dataclass(frozen=True, slots=True)
class State:
    """Everything that the rest of a training depends on.

    Attributes:
        arrays: Whole arrays by name, of numbers or of records of numbers.
        growing: Arrays whose rows never change once they are there; later states have the same rows and more.
        values: JSON values by name.
        at: Where in the training it was taken, for people.
    """

    arrays: Mapping[str, Array] = field(default_factory=dict)
    growing: Mapping[str, Array] = field(default_factory=dict)
    values: Mapping[str, Any] = field(default_factory=dict)
    at: str = ""

    @classmethod
    def joined(cls, at: str, **parts: State) -> State:
        """One state of several; `part` takes it apart again."""

        def join(name: str) -> dict[str, Any]:
            return {f"{key}/{k}": v for key, part in parts.items() for k, v in getattr(part, name).items()}

        return cls(join("arrays"), join("growing"), join("values"), at)

    def part(self, key: str) -> State:
        """The part that `joined` was given under this key."""

        def take(values: Mapping[str, Any]) -> dict[str, Any]:
            return {name[len(key) + 1 :]: value for name, value in values.items() if name.startswith(f"{key}/")}

        return State(take(self.arrays), take(self.growing), take(self.values))


class Checkpoints(Protocol):
    """Where a learner keeps its state. A method that never calls it starts again after a kill."""

    def due(self, steps: int) -> bool:
        """Whether it is time for another checkpoint, at so many simulation steps."""
        ...

    def save(self, steps: int, state: State) -> None:
        """Keep the state after so many simulation steps. Taking it must not change the training: no draws."""
        ...

    def load(self) -> State | None:
        """The newest state that is whole, or None: then the training starts at the beginning."""
        ...


class NoCheckpoints:
    """Keeps nothing."""

    def due(self, steps: int) -> bool:
        """Never."""
        return False

    def save(self, steps: int, state: State) -> None:
        """Forget it."""

    def load(self) -> State | None:
        """Nothing."""
        return None


class Host(Protocol):
    """What surrounds a learner and must go on with it, such as its learning curve."""

    def snapshot(self) -> dict[str, Any]:
        """The state as JSON values."""
        ...

    def restore(self, values: dict[str, Any], steps: int, at: str) -> None:
        """Go on from a `snapshot` that was taken after so many simulation steps, and where in the training."""
        ...


@dataclass(frozen=True, slots=True)
class Interval:
    """A checkpoint is due after so many seconds of wall time or so many simulation steps, whichever comes first."""

    seconds: float = EVERY_S
    steps: int | None = None


class FileCheckpoints:
    """Checkpoints in a folder of their own.

    Args:
        folder: Made with the first checkpoint.
        identity: What must be the same for a training to be continued: specification, code, packages.
        host: Saved and restored with the learner's state.
        interval: How often one is due.
    """

    def __init__(self, folder: Path, identity: str, host: Host | None = None, interval: Interval | None = None) -> None:
        self._folder = folder
        self._identity = identity
        self._host = host
        self._interval = interval or Interval()
        self._number = 0
        self._segments: list[tuple[int, dict[str, int]]] = []
        self._last = time.monotonic(), 0

    def due(self, steps: int) -> bool:
        """Whether the interval is over, by a clock that nobody sets."""
        seconds, before = self._last
        by_steps = self._interval.steps is not None and steps - before >= self._interval.steps
        return by_steps or time.monotonic() - seconds >= self._interval.seconds

    def save(self, steps: int, state: State) -> None:
        """Write the state; where the disk refuses, the training goes on with the checkpoints that are there."""
        try:
            self._write(steps, state)
        except OSError as error:
            print(f"checkpoint at step {steps} not written: {error}", file=sys.stderr, flush=True)
        self._last = time.monotonic(), steps

    def _write(self, steps: int, state: State) -> None:
        number = self._number + 1
        self._folder.mkdir(parents=True, exist_ok=True)
        before = self._segments[-1][1] if self._segments else {}
        new = {name: values[before.get(name, 0) :] for name, values in state.growing.items()}
        segment = number, {name: len(values) for name, values in state.growing.items()}
        head = {
            "format": FORMAT,
            "identity": self._identity,
            "steps": steps,
            "at": state.at,
            "values": dict(state.values),
            "host": None if self._host is None else self._host.snapshot(),
            "segments": [*self._segments, segment],
        }
        if state.growing:
            atomic.write_file(self._rows(number), _pack(new))
        text = json.dumps(head, allow_nan=False).encode()
        atomic.write_file(self._path(number), _pack({**state.arrays, _HEAD: np.frombuffer(text, np.uint8)}))
        self._number = number
        self._segments.append(segment)
        for old in self._numbers()[:-KEPT]:
            self._path(old).unlink(missing_ok=True)

    def load(self) -> State | None:
        """The newest whole state of the same identity; what is torn, or of other code, is removed."""
        for number in reversed(self._numbers()):
            try:
                head, state = self._read(number)
            except _DAMAGE as error:
                print(f"checkpoint {number} is not used: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
                with contextlib.suppress(OSError):
                    self._path(number).unlink()
                continue
            self._number, self._segments = number, [(int(n), sizes) for n, sizes in head["segments"]]
            self._last = time.monotonic(), head["steps"]
            print(f"goes on from step {head['steps']} {state.at}", file=sys.stderr, flush=True)
            if self._host is not None:
                self._host.restore(head["host"], head["steps"], state.at)
            return state
        self.clear()
        return None

    def _read(self, number: int) -> tuple[dict[str, Any], State]:
        arrays = _unpack(self._path(number))
        head: dict[str, Any] = json.loads(arrays.pop(_HEAD).tobytes())
        if head["format"] != FORMAT:
            raise ValueError(f"format {head['format']!r}, this version reads {FORMAT!r}")
        if head["identity"] != self._identity:
            raise ValueError("written for other code, packages or settings")
        segments = [_unpack(self._rows(at)) for at, sizes in head["segments"] if sizes]
        growing: dict[str, Array] = {}
        for name, length in (head["segments"][-1][1] if head["segments"] else {}).items():
            growing[name] = np.concatenate([rows[name] for rows in segments if name in rows])
            if len(growing[name]) != length:
                raise ValueError(f"{name} has {len(growing[name])} rows instead of {length}")
        return head, State(arrays, growing, head["values"], head["at"])

    def clear(self) -> None:
        """Remove all: the training is over, or starts at the beginning."""
        shutil.rmtree(self._folder, ignore_errors=True)
        self._number, self._segments = 0, []

    def _path(self, number: int) -> Path:
        return self._folder / f"{number:06}.npz"

    def _rows(self, number: int) -> Path:
        return self._folder / f"{number:06}.rows.npz"

    def _numbers(self) -> list[int]:
        return sorted(int(path.stem) for path in self._folder.glob("[0-9]*.npz") if path.stem.isdigit())


def _pack(arrays: Mapping[str, Array]) -> bytes:
    sink = io.BytesIO()
    np.savez(sink, allow_pickle=False, **arrays)
    return sink.getvalue()


def _unpack(path: Path) -> dict[str, Array]:
    """All arrays of a file; each is checked against its sum, none may hold objects."""
    return dict(_members(path))


def _members(path: Path) -> Iterator[tuple[str, Array]]:
    with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
        for name in file.files:
            yield name, file[name]

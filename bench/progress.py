"""Where the runs of a ``bench run`` stand: plain values that executors keep and displays draw."""

from __future__ import annotations

import enum
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from bench.spec import RunSpec


class Phase(enum.StrEnum):
    """Where one run stands."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    SKIPPED = "done before"
    ELSEWHERE = "elsewhere"
    """Another ``bench run`` works on it."""
    FAILED = "failed"


@dataclass(slots=True)
class RunStatus:
    """One run.

    Attributes:
        spec: What is run.
        phase: Where it stands.
        stage: ``train`` or ``evaluate`` while it runs.
        done: Simulation steps or episodes done in the stage.
        total: Of so many.
        scalars: Latest numbers of the learner.
        reason: Why it failed, or who runs it elsewhere.
        pid: Worker process on this machine, 0 without one.
        memory: What it said that it holds, 0 where it says nothing [bytes].
        seconds: Duration, once ended.
    """

    spec: RunSpec
    phase: Phase = Phase.QUEUED
    stage: str = ""
    done: int = 0
    total: int = 0
    scalars: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""
    pid: int = 0
    memory: int = 0
    seconds: float = 0.0
    _started: float = 0.0
    _stage_started: float = 0.0
    _stage_done: int = 0

    def start(self, pid: int) -> None:
        """A worker has taken the run, perhaps after another that died."""
        self.phase, self.pid = Phase.RUNNING, pid
        self.stage, self.done, self._stage_done = "", 0, 0
        self._started = self._stage_started = time.monotonic()

    def advance(self, stage: str, done: int, total: int, scalars: Mapping[str, float]) -> None:
        """The worker has reported."""
        if stage != self.stage:
            self.stage, self._stage_started, self._stage_done = stage, time.monotonic(), done
        self.done, self.total = done, total
        self.scalars = {**self.scalars, **scalars}

    def end(self, phase: Phase, reason: str = "") -> None:
        """The run has ended."""
        self.phase, self.reason, self.pid, self.memory = phase, reason, 0, 0
        self.seconds = time.monotonic() - self._started if self._started else 0.0

    @property
    def rate(self) -> float:
        """Steps or episodes per second since this stage was first heard of; what it went on from does not count."""
        elapsed = time.monotonic() - self._stage_started
        return (self.done - self._stage_done) / elapsed if elapsed > 0.0 else 0.0

    @property
    def eta_s(self) -> float | None:
        """Seconds to the end of this stage, or None while unknown."""
        return (self.total - self.done) / self.rate if self.rate > 0.0 else None

    @property
    def percent(self) -> float:
        """Share of the stage that is done."""
        return 100.0 * self.done / self.total if self.total else 0.0


@dataclass(slots=True)
class Board:
    """All runs of one ``bench run``.

    Attributes:
        runs: Statuses, in the order of the request.
        workers: Runs that go on at the same time.
    """

    runs: Sequence[RunStatus]
    workers: int
    started: float = field(default_factory=time.monotonic)

    def count(self, *phases: Phase) -> int:
        """Runs in any of these phases."""
        return sum(run.phase in phases for run in self.runs)

    def eta_s(self) -> float | None:
        """Rough seconds to the end of everything, from the runs that have ended; None while unknown.

        Not less than the longest stage still takes that is under way: whoever trains a risk model for all works longer.
        """
        ended: dict[str, list[float]] = {}
        for run in self.runs:
            if run.phase is Phase.DONE:
                ended.setdefault(run.spec.method, []).append(run.seconds)
        every = [seconds for group in ended.values() for seconds in group]
        if not every:
            return None
        mean = sum(every) / len(every)
        left = longest = 0.0
        for run in self.runs:
            if run.phase in (Phase.QUEUED, Phase.RUNNING):
                group = ended.get(run.spec.method)
                expected = sum(group) / len(group) if group else mean
                running = run.phase is Phase.RUNNING
                spent, stage = (time.monotonic() - run._started, run.eta_s or 0.0) if running else (0.0, 0.0)
                left += max(stage, expected - spent)
                longest = max(longest, stage)
        return max(left / max(1, self.workers), longest)

    def summary(self) -> str:
        """One line: how many are done, running, failed and queued."""
        parts = [f"{self.count(Phase.DONE, Phase.SKIPPED)}/{len(self.runs)} done"]
        for phase in (Phase.RUNNING, Phase.QUEUED, Phase.ELSEWHERE, Phase.FAILED):
            if self.count(phase):
                parts.append(f"{self.count(phase)} {phase}")
        parts.append(f"elapsed {duration(time.monotonic() - self.started)}")
        eta = self.eta_s()
        if eta is not None and self.count(Phase.RUNNING, Phase.QUEUED):
            parts.append(f"about {duration(eta)} left")
        return ", ".join(parts)


class Display(Protocol):
    """Shows a board while it changes. Used as a context manager."""

    def __enter__(self) -> Display:
        """Begin."""

    def __exit__(self, *_: object) -> None:
        """End."""

    def changed(self, run: RunStatus) -> None:
        """A run has started or ended."""

    def refresh(self) -> None:
        """Called several times a second."""


def duration(seconds: float) -> str:
    """``45 s``, ``3 min 20 s``, ``2 h 05 min``."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"

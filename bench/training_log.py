"""What a run notes while its learner trains, through kills and resumes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from bench.errors import LearnerDivergedError

Report = Callable[[str, int, int, Mapping[str, float]], None]
"""Called with stage, amount done, amount in all (simulation steps or episodes) and scalars."""


@dataclass(slots=True)
class Clock:
    """Wall and processor seconds of a stage, over all attempts at it.

    Attributes:
        wall_s: Of what has ended.
        cpu_s: Of what has ended.
    """

    wall_s: float = 0.0
    cpu_s: float = 0.0
    _started: tuple[float, float] | None = None

    def __enter__(self) -> None:
        """Start."""
        self._started = time.perf_counter(), time.process_time()

    def __exit__(self, *_: object) -> None:
        """Stop."""
        self.wall_s, self.cpu_s = self.now()
        self._started = None

    def now(self) -> tuple[float, float]:
        """Wall and processor seconds so far."""
        if self._started is None:
            return self.wall_s, self.cpu_s
        wall, cpu = self._started
        return self.wall_s + time.perf_counter() - wall, self.cpu_s + time.process_time() - cpu

    @property
    def seconds(self) -> dict[str, float]:
        """For ``run.json``."""
        wall, cpu = self.now()
        return {"wall_s": round(wall, 3), "cpu_s": round(cpu, 3)}


@dataclass(slots=True)
class TrainingLog:
    """What a learner reports; the host of its checkpoints (`algorithms.checkpoints.Host`).

    Attributes:
        total: Simulation steps in all.
        report: Told of all progress.
        clock: Of the training.
        scalars: (simulation steps, name, value), the same for the same specification.
        timeline: (simulation steps, seconds since the start of training, time between attempts left out).
        resumes: Where the training went on after a kill: simulation steps, and what was complete there.
    """

    total: int
    report: Report
    clock: Clock = field(default_factory=Clock)
    scalars: list[tuple[int, str, float]] = field(default_factory=list)
    timeline: list[tuple[int, float]] = field(default_factory=list)
    resumes: list[dict[str, Any]] = field(default_factory=list)

    def progress(self, steps: int, scalars: Mapping[str, float]) -> None:
        """The callback of `Task.progress`.

        Raises:
            LearnerDivergedError: A number is not finite.
        """
        for name, value in scalars.items():
            if not math.isfinite(value):
                raise LearnerDivergedError(f"{name} is {value} at simulation step {steps}.")
            self.scalars.append((steps, name, float(value)))
        self.timeline.append((steps, round(self.clock.now()[0], 3)))
        self.report("train", steps, self.total, scalars)

    def snapshot(self) -> dict[str, Any]:
        """JSON values for a checkpoint."""
        return {
            "scalars": list(self.scalars),
            "timeline": list(self.timeline),
            "resumes": list(self.resumes),
            "seconds": self.clock.now(),
        }

    def restore(self, values: dict[str, Any], steps: int, at: str) -> None:
        """Go on from a `snapshot` that was taken after so many simulation steps."""
        self.scalars[:] = [(at, name, value) for at, name, value in values["scalars"]]
        self.timeline[:] = [(at, seconds) for at, seconds in values["timeline"]]
        self.resumes[:] = [*values["resumes"], {"steps": steps, "at": at}]
        wall, cpu = values["seconds"]
        self.clock.wall_s += wall
        self.clock.cpu_s += cpu
        self.report("train", steps, self.total, {})

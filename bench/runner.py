"""One `RunSpec` to one record: train, save, evaluate, write."""

from __future__ import annotations

import math
import random
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from algorithms.method import Budget, Method, Policy, Task
from algorithms.registry import get_method
from bench import schema, store
from bench.errors import LearnerDivergedError, RunFailedError
from bench.evaluate import evaluate
from bench.provenance import provenance, without_paths
from bench.records import Record, read_record
from bench.spec import RunSpec
from bench.store import Failure, RunFolder, Store
from envs.driving_env import CostSignal
from envs.world import Records

Report = Callable[[str, int, int, Mapping[str, float]], None]
"""Called with stage, amount done, amount in all (simulation steps or episodes) and scalars."""


@dataclass(slots=True)
class Clock:
    """Wall and processor seconds of a stage."""

    wall_s: float = 0.0
    cpu_s: float = 0.0
    _wall: float = 0.0
    _cpu: float = 0.0

    def __enter__(self) -> None:
        """Start."""
        self._wall, self._cpu = time.perf_counter(), time.process_time()

    def __exit__(self, *_: object) -> None:
        """Stop."""
        self.wall_s = time.perf_counter() - self._wall
        self.cpu_s = time.process_time() - self._cpu

    @property
    def seconds(self) -> dict[str, float]:
        """For ``run.json``."""
        return {"wall_s": round(self.wall_s, 3), "cpu_s": round(self.cpu_s, 3)}


@dataclass(slots=True)
class Training:
    """What a learner reports while it trains.

    Attributes:
        scalars: (simulation steps, name, value), the same for the same specification.
        timeline: (simulation steps, seconds since the start of training).
    """

    spec: RunSpec
    report: Report
    scalars: list[tuple[int, str, float]] = field(default_factory=list)
    timeline: list[tuple[int, float]] = field(default_factory=list)
    started: float = field(default_factory=time.perf_counter)

    def progress(self, steps: int, scalars: Mapping[str, float]) -> None:
        """The callback of `Task.progress`.

        Raises:
            LearnerDivergedError: A number is not finite.
        """
        for name, value in scalars.items():
            if not math.isfinite(value):
                raise LearnerDivergedError(f"{name} is {value} at simulation step {steps}.")
            self.scalars.append((steps, name, float(value)))
        self.timeline.append((steps, round(time.perf_counter() - self.started, 3)))
        self.report("train", steps, self.spec.steps, scalars)


@dataclass(slots=True)
class _Attempt:
    """One attempt at a run; knows how far it came."""

    spec: RunSpec
    folder: RunFolder
    cache: Path
    report: Report
    stage: str = "setup"
    task: Task | None = None
    training: Training | None = None
    clocks: dict[str, Clock] = field(default_factory=lambda: {"train": Clock(), "evaluate": Clock()})

    def execute(self) -> None:
        details: dict[str, Any] = {"provenance": provenance()}
        self.folder.write_run(details)
        method = get_method(self.spec.method)
        self._check_version(method)
        policy = self._train(method)
        episodes = self._evaluate(policy)
        self.stage = "write"
        self.folder.write_policy(policy.save)
        self._write_tables(method, episodes)
        assert self.task is not None
        assert self.training is not None
        self.folder.write_run(
            {
                **details,
                "steps_done": self.task.steps_done(),
                "timing": {name: clock.seconds for name, clock in self.clocks.items()},
                "timeline": [list(point) for point in self.training.timeline],
                "trains": method.trains,
            }
        )
        self.folder.finish()

    def _check_version(self, method: Method) -> None:
        if method.version != self.spec.method_version:
            raise ValueError(
                f"{self.spec.label}: the run is for version {self.spec.method_version} of the method, "
                f"this is version {method.version}."
            )

    def _train(self, method: Method) -> Policy:
        self.stage = "train"
        self.training = Training(self.spec, self._reported)
        self.task = Task(
            scenario=self.spec.resolve_scenario(),
            seed=self.spec.seed,
            budget=Budget(self.spec.steps),
            cost_limit=self.spec.cost_limit,
            cost_signal=CostSignal[self.spec.cost_signal.upper()],
            settings=dict(self.spec.settings),
            cache=self.cache,
            progress=self.training.progress,
        )
        seed_global_generators(self.task)
        self._reported("train", 0, self.spec.steps, {})
        with self.clocks["train"]:
            return method.train(self.task)

    def _evaluate(self, policy: Policy) -> Records:
        self.stage = "evaluate"
        assert self.task is not None
        n = self.spec.eval_episodes
        self._reported("evaluate", 0, n, {})
        with self.clocks["evaluate"]:
            return evaluate(
                policy,
                self.task.scenario,
                n,
                cost_signal=self.task.cost_signal,
                progress=lambda done: self._reported("evaluate", done, n, {}),
            )

    def _write_tables(self, method: Method, episodes: Records) -> None:
        assert self.task is not None
        assert self.training is not None
        trained = self.task.finished_episodes()
        self.folder.write(
            store.TRAIN_FILE,
            schema.to_bytes(schema.episodes_table(trained if method.trains else trained[:0])),
        )
        self.folder.write(store.EVAL_FILE, schema.to_bytes(schema.episodes_table(episodes)))
        self.folder.write(store.SCALARS_FILE, schema.to_bytes(schema.scalars_table(self.training.scalars)))

    def _reported(self, stage: str, done: int, total: int, scalars: Mapping[str, float]) -> None:
        self.folder.touch()
        self.report(stage, done, total, scalars)

    def failure(self, error: Exception) -> Failure:
        step = 0 if self.task is None else self.task.steps_done()
        reason = without_paths(str(error)).strip() or type(error).__name__
        if not isinstance(error, LearnerDivergedError):
            reason = f"{type(error).__name__}: {reason}"
        return Failure(self.stage, step, reason, without_paths("".join(traceback.format_exception(error))))


def seed_global_generators(task: Task) -> None:
    """Some learners draw from global generators: give each run its own state, whatever ran before it."""
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(task.torch_seed())
    seed = int(task.stream("global").generate_state(1)[0])
    np.random.seed(seed)  # noqa: NPY002
    random.seed(seed)


def run(spec: RunSpec, results: Path, report: Report = lambda *_: None) -> Record:
    """Run one specification and write its record.

    Args:
        spec: What to run.
        results: The results folder.
        report: Told of progress; what it raises ends the run.

    Raises:
        AlreadyDoneError: The run is done.
        LockedError: Another process works on it.
        RunFailedError: It failed; ``FAILED`` in its folder says why.
    """
    target = Store(results)
    with target.begin(spec) as folder:
        attempt = _Attempt(spec, folder, target.cache, report)
        try:
            attempt.execute()
        except Exception as error:
            failure = attempt.failure(error)
            try:
                folder.fail(failure)
            except OSError as disk:
                raise RunFailedError(f"{failure.reason} (and FAILED could not be written: {disk})") from error
            raise RunFailedError(f"step {failure.step} ({failure.stage}): {failure.reason}") from error
        return read_record(folder.path)

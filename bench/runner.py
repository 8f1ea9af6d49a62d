"""One `RunSpec` to one record: train, save, evaluate, write; a run that was killed goes on where it was."""

from __future__ import annotations

import random
import shutil
import traceback
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from algorithms.checkpoints import FileCheckpoints, Interval
from algorithms.compiler_left_out import leave_compiler_out
from algorithms.method import Budget, Method, Task
from algorithms.registry import get_method
from bench import schema, store
from bench.errors import LearnerDivergedError, RunFailedError
from bench.evaluate import evaluate
from bench.provenance import provenance, run_identity, without_paths
from bench.records import Record, read_record
from bench.spec import RunSpec
from bench.store import Failure, RunFolder, Store
from bench.training_log import Clock, Report, TrainingLog
from envs.driving_env import CostSignal

GLOBAL, GLOBAL_IN_EVALUATION = "global", "global in evaluation"
STREAMS: Final = ("train", "policy", "shield", GLOBAL, GLOBAL_IN_EVALUATION)
"""Named seed streams of a run; the held-out list has one of its own, the same for all."""


@dataclass(slots=True)
class _Attempt:
    """One attempt at a run; knows how far it came."""

    spec: RunSpec
    folder: RunFolder
    cache: Path
    report: Report
    interval: Interval
    stage: str = "setup"
    task: Task | None = None
    steps: int = 0

    def execute(self) -> None:
        details: dict[str, Any] = {"provenance": provenance()}
        self.folder.write_run(details)
        method = get_method(self.spec.method)
        self._check_version(method)
        details["resolved"] = resolved(method, self._make_task())
        identity = run_identity(method, self.spec.hash)
        trained = self.folder.trained(identity)
        if trained is None:
            trained = self._train(method, identity)
            self.folder.mark_trained(identity, trained)
        shutil.rmtree(self.folder.checkpoints, ignore_errors=True)
        self.steps = trained["steps_done"]
        timing = self._evaluate(method)
        self.folder.write_run({**details, **trained, "timing": {**trained["timing"], "evaluate": timing}})
        self.folder.finish()

    def _check_version(self, method: Method) -> None:
        if method.version != self.spec.method_version:
            raise ValueError(
                f"{self.spec.label}: the run is for version {self.spec.method_version} of the method, "
                f"this is version {method.version}."
            )

    def _make_task(self) -> Task:
        task = Task(
            scenario=self.spec.resolve_scenario(),
            seed=self.spec.seed,
            budget=Budget(self.spec.steps),
            cost_limit=self.spec.cost_limit,
            cost_signal=CostSignal[self.spec.cost_signal.upper()],
            settings=dict(self.spec.settings),
            cache=self.cache,
            making=lambda what, done, total: self._reported(what, done, total, {}),
        )
        self.task = task
        return task

    def _train(self, method: Method, identity: str) -> dict[str, Any]:
        """Train, write what training leaves, and return what ``run.json`` says of it."""
        self.stage = "train"
        assert self.task is not None
        task, curve = self.task, TrainingLog(self.spec.steps, self._reported)
        task.progress = curve.progress
        task.checkpoints = FileCheckpoints(self.folder.checkpoints, identity, curve, self.interval)
        seed_global_generators(task, GLOBAL)
        leave_compiler_out()
        if not self.folder.checkpoints.exists():  # else the first amount told is the one it goes on from
            self._reported("train", 0, self.spec.steps, {})
        with curve.clock:
            policy = method.train(task)
        self.stage = "write"
        self.folder.write_policy(policy.save)
        episodes = task.finished_episodes()
        self._write_table(store.TRAIN_FILE, schema.episodes_table(episodes if method.trains else episodes[:0]))
        self._write_table(store.SCALARS_FILE, schema.scalars_table(curve.scalars))
        return {
            "steps_done": task.steps_done(),
            "timing": {"train": curve.clock.seconds},
            "timeline": [list(point) for point in curve.timeline],
            "resumes": curve.resumes,
            "trains": method.trains,
        }

    def _evaluate(self, method: Method) -> dict[str, float]:
        """Judge the policy that was written, so that it does not matter which process had trained it; the time."""
        self.stage = "evaluate"
        assert self.task is not None
        task, n, clock = self.task, self.spec.eval_episodes, Clock()
        seed_global_generators(task, GLOBAL_IN_EVALUATION)
        self._reported("evaluate", 0, n, {})
        with clock:
            policy = method.load_policy(self.folder.path / store.POLICY_FOLDER, task)
            episodes = evaluate(
                policy,
                task.scenario,
                n,
                cost_signal=task.cost_signal,
                progress=lambda done: self._reported("evaluate", done, n, {}),
            )
        self.stage = "write"
        self._write_table(store.EVAL_FILE, schema.episodes_table(episodes))
        return clock.seconds

    def _write_table(self, name: str, table: pa.Table) -> None:
        self.folder.write(name, schema.to_bytes(table))

    def _reported(self, stage: str, done: int, total: int, scalars: Mapping[str, float]) -> None:
        self.folder.touch()
        self.report(stage, done, total, scalars)

    def failure(self, error: Exception) -> Failure:
        step = max(self.steps, 0 if self.task is None else self.task.steps_done())
        reason = without_paths(str(error)).strip() or type(error).__name__
        if not isinstance(error, LearnerDivergedError):
            reason = f"{type(error).__name__}: {reason}"
        return Failure(self.stage, step, reason, without_paths("".join(traceback.format_exception(error))))


def resolved(method: Method, task: Task) -> dict[str, Any]:
    """The specification with every default filled in, and the seed of every named stream, for ``run.json``."""
    scenario = {key: getattr(value, "value", value) for key, value in asdict(task.scenario).items()}
    streams = {name: f"{task.stream(name).entropy:032x}" for name in STREAMS}
    return {
        "scenario": {"id": task.scenario.id, **scenario},
        "method": {"name": method.name, "version": method.version, "parameters": method.parameters},
        "seeds": {"replicate": task.seed, "torch": task.torch_seed(), "streams": streams},
    }


def seed_global_generators(task: Task, stream: str) -> None:
    """Some learners draw from global generators: give each stage its own state, whatever ran before it."""
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(task.torch_seed())
    seed = int(task.stream(stream).generate_state(1)[0])
    np.random.seed(seed)  # noqa: NPY002
    random.seed(seed)


def run(
    spec: RunSpec, results: Path, report: Report = lambda *_: None, checkpoint_every: Interval | None = None
) -> Record:
    """Run one specification and write its record.

    Where an earlier attempt was killed, it goes on from its last checkpoint, or from its trained policy.

    Args:
        spec: What to run.
        results: The results folder.
        report: Told of progress; what it raises ends the run.
        checkpoint_every: By default a minute.

    Raises:
        AlreadyDoneError: The run is done.
        LockedError: Another process works on it.
        RunFailedError: It failed; ``FAILED`` in its folder says why.
    """
    target = Store(results)
    with target.begin(spec) as folder:
        attempt = _Attempt(spec, folder, target.cache, report, checkpoint_every or Interval())
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

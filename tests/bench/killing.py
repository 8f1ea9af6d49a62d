"""Runs in processes of their own that are killed at random moments, and what their records must equal."""

import contextlib
import multiprocessing
import random
import shutil
import sys
from collections.abc import Callable
from multiprocessing import forkserver
from pathlib import Path

import psutil

from algorithms.checkpoints import Interval
from bench import store
from bench.errors import AlreadyDoneError
from bench.records import Record, read_record
from bench.runner import run
from bench.spec import RunSpec
from bench.store import State, Store

PRELOADED = ["bench.runner", "stable_baselines3", "tests.bench.warm"]
"""Imported once; every attempt is a fork of the process that holds them, so that kills fall into the run itself."""

TICK_S = 0.01


def attempt(spec: str, results: Path, every_steps: int) -> None:
    """The process that is killed."""
    assert set(PRELOADED) <= sys.modules.keys()  # else most kills would fall into imports
    (results / "log").parent.mkdir(parents=True, exist_ok=True)
    with (results / "log").open("a") as log, contextlib.redirect_stderr(log), contextlib.suppress(AlreadyDoneError):
        run(RunSpec.model_validate_json(spec), results, checkpoint_every=Interval(3600.0, every_steps))


class Killing:
    """Runs one specification and kills it."""

    def __init__(
        self, spec: RunSpec, every_steps: int, prepare: Callable[[Path], None] = lambda _results: None
    ) -> None:
        """Take a specification, and what every results folder must hold before."""
        self._spec, self._every_steps, self._prepare = spec, every_steps, prepare
        forkserver._forkserver._stop()  # of an earlier test: it would have imported other modules
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(PRELOADED)

    def whole(self, results: Path) -> tuple[Record, float]:
        """The record of an uninterrupted run, and the processor seconds that it took."""
        self._prepare(results)
        self._finish(results)  # makes shared artefacts, compiles kernels
        shutil.rmtree(Store(results).folder(self._spec))
        process = self._start(results)
        seconds = 0.0
        while process.is_alive():
            seconds = max(seconds, _processor_seconds(process))
            process.join(TICK_S)
        assert process.exitcode == 0, (results / "log").read_text()
        return read_record(Store(results).folder(self._spec)), seconds

    def killed(self, results: Path, kills: int, seconds: float, seed: int) -> list[Record]:
        """Records of runs that were killed so many times in all, at moments spread over their whole duration.

        Moments are in processor time, so that they are spread on a busy machine, too.
        """
        rng, done, left = random.Random(seed), [], kills
        folder = results / "0"
        self._prepare(folder)
        while left:
            process, until = self._start(folder), rng.uniform(0.0, seconds)
            while process.is_alive() and _processor_seconds(process) < until:
                process.join(TICK_S)
            if process.is_alive():
                process.kill()
                left -= 1
            process.join()
            assert process.exitcode in (0, -9), (folder / "log").read_text()
            if Store(folder).state(self._spec) is State.DONE:
                done.append(read_record(Store(folder).folder(self._spec)))
                folder = results / str(len(done))
                self._prepare(folder)
        self._finish(folder)
        return [*done, read_record(Store(folder).folder(self._spec))]

    def _finish(self, results: Path) -> None:
        process = self._start(results)
        process.join()
        assert process.exitcode == 0, (results / "log").read_text()

    def _start(self, results: Path) -> multiprocessing.process.BaseProcess:
        arguments = (self._spec.model_dump_json(), results, self._every_steps)
        process = self._context.Process(target=attempt, args=arguments)
        process.start()
        return process


def _processor_seconds(process: multiprocessing.process.BaseProcess) -> float:
    with contextlib.suppress(psutil.Error):
        times = psutil.Process(process.pid).cpu_times()
        return times.user + times.system
    return 0.0


def differences(record: Record, other: Record) -> list[str]:
    """Files that differ, run.json apart: it tells of time and machine."""
    names = (record.seals.keys() | other.seals.keys()) - {store.RUN_FILE}
    return sorted(name for name in names if record.seals.get(name) != other.seals.get(name))


def leftovers(record: Record) -> list[str]:
    """What only an unfinished run may hold."""
    return [p.name for p in record.path.iterdir() if p.name in (store.CHECKPOINT_FOLDER, store.TRAINED_FILE)]

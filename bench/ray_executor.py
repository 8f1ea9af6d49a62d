"""Runs on a Ray cluster: one core each; records come back through the results folder, which all nodes share.

A run whose node died is handed out again and goes on from its last checkpoint. A run that takes its own process
down has failed, as with local processes.
"""

from __future__ import annotations

import contextlib
import importlib
import logging
import os
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from bench import worker
from bench.errors import UsageError
from bench.executors import OUTCOMES
from bench.fork_server import one_thread
from bench.lock import SILENT_S
from bench.progress import Board, Display, Phase, RunStatus
from bench.provenance import usable_cores
from bench.store import Failure, State, Store

TICK_S: Final = 0.5
STOP_S: Final = 2.0
ATTEMPTS: Final = 4
"""Nodes that may die under one run."""
LOCKED_S: Final = 5.0
"""Between two looks at the lock of a node that died."""
STORE_BYTES: Final = 100 * 2**20
"""Ray's object store on a machine of our own: nothing but progress goes through it."""


class RayExecutor:
    """Runs specifications on a Ray cluster.

    Args:
        results: The results folder, at the same path on every node.
        workers: Runs at a time; by default one for each of the cluster's cores.
        address: Of a running cluster, or None to start one on this machine.
        track: Where else scalars go, see `bench.tracking`.

    Attributes:
        workers: Runs at a time.
        places: Ray's id of the node on which a run was last seen, by the run's folder name.

    Raises:
        UsageError: Ray is not installed, or there is no cluster at the address.
    """

    def __init__(
        self, results: Path, workers: int | None = None, address: str | None = None, track: str | None = None
    ) -> None:
        self._track = track
        self._ray = _connect(address, workers)
        self._results = results.resolve()
        self._store = Store(self._results)
        self.workers = workers or max(1, int(self._ray.cluster_resources().get("CPU", 1)))
        self.places: dict[str, str] = {}
        self._running: dict[Any, RunStatus] = {}
        self._attempts: dict[str, int] = {}

    @contextlib.contextmanager
    def ready(self) -> Iterator[None]:
        """The cluster is there; it is left afterwards."""
        try:
            yield
        finally:
            self._ray.shutdown()

    def execute(self, board: Board, display: Display) -> None:
        """Run every queued run of the board to its end.

        Raises:
            KeyboardInterrupt: Ctrl-C; the tasks have been cancelled, their runs go on where they were.
        """
        queue = deque(run for run in board.runs if run.phase is Phase.QUEUED)
        mailbox = self._mailbox()
        try:
            while queue or self._running:
                while queue and len(self._running) < self.workers:
                    run = queue.popleft()
                    self._hand_out(run, mailbox)
                    display.changed(run)
                ended, _ = self._ray.wait(list(self._running), timeout=TICK_S)
                for name, message in self._ray.get(mailbox.take.remote()):
                    self._take(name, message)
                for task in ended:
                    self._end(task, queue, display)
                display.refresh()
        finally:
            self._stop()

    def _mailbox(self) -> Any:
        """Where tasks leave their progress: an actor on the node of this process, which outlives the others."""
        strategies = importlib.import_module("ray.util.scheduling_strategies")
        here = strategies.NodeAffinitySchedulingStrategy(self._ray.get_runtime_context().get_node_id(), soft=False)
        return self._ray.remote(Mailbox).options(num_cpus=0, scheduling_strategy=here).remote()

    def _hand_out(self, run: RunStatus, mailbox: Any) -> None:
        name = run.spec.folder_name
        again = self._attempts.get(name, 0) > 0
        self._attempts[name] = self._attempts.get(name, 0) + 1
        # Ray itself gives a task of one core one OpenMP thread.
        task = self._ray.remote(work).options(num_cpus=1, max_retries=0)
        text = run.spec.model_dump_json()
        self._running[task.remote(name, text, self._results, mailbox, again, self._track)] = run
        run.start(0)

    def _take(self, name: str, message: tuple[Any, ...]) -> None:
        node, memory, stage, done, total, scalars = message
        self.places[name] = node
        for run in self._running.values():
            if run.spec.folder_name == name:
                run.memory = memory
                run.advance(stage, done, total, scalars)

    def _end(self, task: Any, queue: deque[RunStatus], display: Display) -> None:
        run = self._running.pop(task)
        try:
            outcome, reason = self._ray.get(task)
            run.end(OUTCOMES[outcome], reason)
            if run.phase is Phase.FAILED and self._store.state(run.spec) is not State.FAILED:
                self._mark_failed(run)
        except self._ray.exceptions.RayError as error:
            if self._node_died(run, error) and self._attempts[run.spec.folder_name] < ATTEMPTS:
                run.phase = Phase.QUEUED
                queue.appendleft(run)
            else:
                run.end(Phase.FAILED, _first_line(error))
                self._mark_failed(run)
        display.changed(run)

    def _node_died(self, run: RunStatus, error: Exception) -> bool:
        if isinstance(error, self._ray.exceptions.NodeDiedError):
            return True
        place = self.places.get(run.spec.folder_name)
        return any(node["NodeID"] == place and not node["Alive"] for node in self._ray.nodes())

    def _mark_failed(self, run: RunStatus) -> None:
        step = run.done if run.stage == "train" else 0
        with contextlib.suppress(OSError):
            self._store.fail(run.spec, Failure("worker", step, run.reason))

    def _stop(self) -> None:
        """Cancel what still runs."""
        tasks = list(self._running)
        for force in (False, True):
            for task in tasks:
                with contextlib.suppress(self._ray.exceptions.RayError):
                    self._ray.cancel(task, force=force)
            if tasks:
                _, tasks = self._ray.wait(tasks, num_returns=len(tasks), timeout=STOP_S)
        self._running.clear()


class Mailbox:
    """Progress of all tasks, until it is taken."""

    def __init__(self) -> None:
        self._messages: dict[str, tuple[Any, ...]] = {}

    def put(self, name: str, message: tuple[Any, ...]) -> None:
        """Keep a run's newest progress."""
        self._messages[name] = message

    def take(self) -> list[tuple[str, tuple[Any, ...]]]:
        """The newest progress of each run that reported since the last call."""
        taken, self._messages = list(self._messages.items()), {}
        return taken


def work(name: str, spec: str, results: Path, mailbox: Any, again: bool, track: str | None) -> tuple[str, str]:
    """What a task does; its outcome (`bench.worker.DONE`, `FAILED` or `LOCKED`) and reason.

    Args:
        name: Folder name of the run.
        spec: JSON of its `RunSpec`.
        results: The results folder.
        mailbox: A `Mailbox` actor.
        again: Whether a node has died under this run: its lock may then look alive from another host for a while.
        track: Where else scalars go.
    """
    import psutil

    ray: Any = importlib.import_module("ray")
    node, process = ray.get_runtime_context().get_node_id(), psutil.Process()

    def send(*progress: Any) -> None:
        mailbox.put.remote(name, (node, process.memory_info().rss, *progress))

    deadline = time.monotonic() + (SILENT_S + 60.0 if again else 0.0)
    while True:
        outcome, reason = worker.run_one(spec, results, send, track)
        if outcome != worker.LOCKED or time.monotonic() >= deadline:
            return outcome, reason
        time.sleep(LOCKED_S)


def _connect(address: str | None, workers: int | None) -> Any:
    try:
        ray: Any = importlib.import_module("ray")
    except ImportError as error:
        raise UsageError("--executor ray: the package ray is not installed; pip install '.[ray]'.") from error
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    options: dict[str, Any] = {"address": address, "log_to_driver": False, "logging_level": logging.ERROR}
    if address is None:
        cores = workers or usable_cores()
        options |= {"num_cpus": cores, "object_store_memory": STORE_BYTES, "include_dashboard": False}
    try:
        with one_thread():
            ray.init(**options)
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise UsageError(f"--address {address}: no Ray cluster there ({_first_line(error)}).") from error
    return ray


def _first_line(error: Exception) -> str:
    return next(iter(str(error).strip().splitlines()), "") or type(error).__name__

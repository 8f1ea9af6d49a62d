"""Runs on a Ray cluster of two nodes, one of which is killed: nothing is lost, and nobody can tell from the records."""

import contextlib
import importlib
import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from algorithms.registry import get_method
from bench import ray_executor, sweep
from bench.display import Silent
from bench.errors import UsageError
from bench.progress import Board, Phase
from bench.ray_executor import RayExecutor
from bench.records import read_record
from bench.run_command import Options
from bench.runner import run
from bench.spec import RunSpec
from bench.store import Store
from tests.bench.killing import differences

Make = Callable[..., RunSpec]
needs_ray = pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="ray is not installed (the extra ray)")
# Ray's own processes and sockets, closed with the cluster.
ray_warnings = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning",
                                          "ignore::FutureWarning", "ignore::DeprecationWarning")  # fmt: skip


@pytest.fixture(autouse=True)
def equal_priority(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray's workers give way to all others by default: on a busy machine they would starve."""
    monkeypatch.setenv("RAY_worker_niceness", "0")


@pytest.fixture
def cluster() -> Iterator[Any]:
    """The head, with a core for one run; nodes are added by tests."""
    utilities = importlib.import_module("ray.cluster_utils")
    node = {"object_store_memory": 80 * 2**20, "include_dashboard": False}
    made = utilities.Cluster(initialize_head=True, head_node_args={"num_cpus": 1, **node})
    try:
        yield made
    finally:
        importlib.import_module("ray").shutdown()
        with contextlib.suppress(Exception):
            made.shutdown()


class Killer(Silent):
    """Takes a node away as soon as a run on it has trained for a while."""

    def __init__(self, board: Board, executor: RayExecutor, kill: Callable[[], None], node: str) -> None:
        super().__init__(board)
        self._executor, self._kill, self._node = executor, kill, node
        self.killed: str | None = None

    def refresh(self) -> None:
        for status in self.board.runs:
            name = status.spec.folder_name
            there = status.phase is Phase.RUNNING and self._executor.places.get(name) == self._node
            if self.killed is None and there and status.stage == "train":
                self.killed = name
                self._kill()


@needs_ray
@ray_warnings
@pytest.mark.slow
def test_a_killed_node_of_two_loses_nothing_ray(cluster: Any, tmp_path: Path, make_spec: Make) -> None:
    second = cluster.add_node(num_cpus=1, object_store_memory=80 * 2**20)
    cluster.wait_for_nodes()
    version = get_method("sac").version
    specs = [make_spec(method="sac", method_version=version, steps=2_400, eval_episodes=8, seed=i) for i in range(3)]
    executor = RayExecutor(tmp_path / "ray", address=cluster.address)
    assert executor.workers == 2
    board = sweep.plan(specs, tmp_path / "ray", executor.workers)
    killer = Killer(board, executor, lambda: cluster.remove_node(second, allow_graceful=False), second.node_id)
    with executor.ready():
        sweep.execute(board, executor, killer)
    assert killer.killed is not None
    assert [(status.phase, status.reason) for status in board.runs] == [(Phase.DONE, "")] * 3
    assert executor._attempts[killer.killed] == 2
    victim = next(spec for spec in specs if spec.folder_name == killer.killed)
    record = read_record(Store(tmp_path / "ray").folder(victim))
    assert differences(record, run(victim, tmp_path / "here")) == []
    again = sweep.plan(specs, tmp_path / "ray", 2)
    assert again.count(Phase.SKIPPED) == 3


@needs_ray
@ray_warnings
@pytest.mark.slow
def test_a_failing_a_dying_and_a_locked_run_stop_nobody_kill_ray(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    dying, failing, last = make_spec(method="fake-dying"), make_spec(method="fake-failing"), make_spec(seed=2)
    locked = make_spec(seed=1)
    executor = RayExecutor(tmp_path, workers=1)
    board = sweep.plan([dying, failing, locked, last], tmp_path, 1)
    with executor.ready(), Store(tmp_path).begin(locked):
        sweep.execute(board, executor, Silent(board))
    assert [status.phase for status in board.runs] == [Phase.FAILED, Phase.FAILED, Phase.ELSEWHERE, Phase.DONE]
    assert "step 240 (train): RuntimeError: the learner tripped" in board.runs[1].reason
    failure = Store(tmp_path).failure(dying)
    assert failure is not None
    assert failure.stage == "worker"


def test_without_ray_the_remedy_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(ray_executor.importlib, "import_module", missing)
    with pytest.raises(UsageError, match=r"ray is not installed; pip install '\.\[ray\]'"):
        RayExecutor(tmp_path)


def test_an_unknown_executor_and_an_address_without_ray_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--executor slurm: must be one of local, ray"):
        Options(tmp_path, 1, False, True, False, executor="slurm").make_executor()
    with pytest.raises(UsageError, match="--address auto: only with --executor ray"):
        Options(tmp_path, 1, False, True, False, address="auto").make_executor()

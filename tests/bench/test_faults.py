"""Whatever goes wrong with one run, it is a row with its reason, and nothing that was done is changed."""

import contextlib
import json
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from algorithms import atomic
from algorithms.registry import get_method
from bench import sweep
from bench.display import Silent
from bench.errors import AlreadyDoneError, LockedError, RecordError, RunFailedError
from bench.executors import LocalExecutor
from bench.lock import RunLock
from bench.progress import Phase
from bench.records import collect, read_record
from bench.runner import run
from bench.spec import RunSpec
from bench.store import State, Store
from tests.bench.killing import differences

Make = Callable[..., RunSpec]
MakeRecord = Callable[..., Path]
Bench = Callable[..., Result]


def content(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


class FullDisk:
    """The n-th call of os.fsync, os.replace or os.rename, and all that follow it, fail."""

    def __init__(self, patch: pytest.MonkeyPatch, fails_from: int) -> None:
        self.calls, self._fails_from = 0, fails_from
        for name in ("fsync", "replace", "rename"):
            patch.setattr(os, name, self._failing(getattr(os, name)))

    def _failing(self, real: Callable[..., None]) -> Callable[..., None]:
        def call(*arguments: object) -> None:
            self.calls += 1
            if self.calls >= self._fails_from:
                raise OSError(28, "No space left on device")
            real(*arguments)

        return call


def _on_a_full_disk(spec: RunSpec, results: Path, fails_from: int) -> int:
    with pytest.MonkeyPatch.context() as patch:
        disk = FullDisk(patch, fails_from)
        with contextlib.suppress(RunFailedError):
            run(spec, results)
        return disk.calls


@pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.slow), 6])
def test_a_disk_that_is_full_from_any_write_on_costs_one_run_and_no_record(
    fakes: Path, tmp_path: Path, make_spec: Make, every: int
) -> None:
    whole = run(make_spec(), tmp_path / "whole")
    calls = _on_a_full_disk(make_spec(seed=9), tmp_path / "count", 10**6)
    done = run(make_spec(seed=1), tmp_path / "disk").path
    before = content(done)
    for n in range(1, calls + 1, every):
        results = tmp_path / "disk"
        _on_a_full_disk(make_spec(), results, n)
        assert content(done) == before
        assert not list(results.rglob(f"{atomic.TEMPORARY}*"))
        try:
            again = run(make_spec(), results)  # the disk has space again
        except AlreadyDoneError:
            assert n == calls, "only the last sync comes after DONE"
            again = read_record(Store(results).folder(make_spec()))
        assert differences(again, whole) == []
        for path in sorted(again.path.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink()


def test_a_run_beyond_its_memory_limit_fails_alone(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    done = run(make_spec(seed=1), tmp_path).path
    before = content(done)
    specs = [make_spec(method="fake-hungry"), make_spec(seed=1), make_spec(seed=2)]
    board = sweep.plan(specs, tmp_path, workers=1)
    sweep.execute(board, LocalExecutor(tmp_path, 1), Silent(board))
    assert [status.phase for status in board.runs] == [Phase.FAILED, Phase.SKIPPED, Phase.DONE]
    failure = Store(tmp_path).failure(specs[0])
    assert failure is not None
    assert (failure.stage, failure.step) == ("train", 240)
    assert "MemoryError" in failure.reason
    assert content(done) == before


def test_a_learner_whose_numbers_blow_up_stops_with_the_step(tmp_path: Path, make_spec: Make) -> None:
    settings = {"learning_rate": "1e30", "warm_up": "160"}
    spec = make_spec(method="sac", method_version=get_method("sac").version, steps=4_000, settings=settings)
    with pytest.raises(RunFailedError, match=r"step \d+ \(train\)"):
        run(spec, tmp_path)
    failure = Store(tmp_path).failure(spec)
    assert failure is not None
    assert 0 < failure.step < 4_000
    assert "nan" in failure.reason.lower() or "inf" in failure.reason.lower()
    assert Store(tmp_path).state(spec) is State.FAILED


def test_a_table_that_became_unreadable_is_refused_and_its_neighbours_are_not(
    tmp_path: Path, make_record: MakeRecord
) -> None:
    bad, good = make_record(tmp_path), make_record(tmp_path, seed=1)
    table = bad / "eval_episodes.parquet"
    table.write_bytes(table.read_bytes()[::-1])
    with pytest.raises(RecordError, match=r"eval_episodes\.parquet is not what was sealed"):
        read_record(bad).eval_episodes()
    assert read_record(good).eval_episodes().num_rows == 20
    assert len(collect(tmp_path).records) == 2


def test_two_writers_of_one_run_are_one_and_a_refusal_whatever_the_clock_says(
    fakes: Path, tmp_path: Path, make_spec: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = time.time()
    with Store(tmp_path).begin(make_spec()) as folder:
        for jump_s in (0.0, 7 * 86_400.0, -7 * 86_400.0):
            monkeypatch.setattr(time, "time", lambda jump_s=jump_s: now + jump_s)
            with pytest.raises(LockedError, match=f"process {os.getpid()}"):
                run(make_spec(), tmp_path)
            with pytest.raises(LockedError), RunLock(folder.path):
                pass
        assert Store(tmp_path).state(make_spec()) is State.RUNNING
    run(make_spec(), tmp_path)


def test_durations_do_not_follow_a_clock_that_is_set(
    fakes: Path, tmp_path: Path, make_spec: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    times = iter(range(10**9, 0, -(10**6)))
    monkeypatch.setattr(time, "time", lambda: float(next(times)))
    record = run(make_spec(), tmp_path)
    seconds = [at for _, at in record.details["timeline"]]
    assert seconds == sorted(seconds)
    assert all(0.0 <= timing["wall_s"] < 3600.0 for timing in record.details["timing"].values())


def test_a_run_that_is_done_stays_whatever_is_asked_of_it(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    record = run(make_spec(), tmp_path)
    before = content(record.path)
    with pytest.raises(AlreadyDoneError):
        run(make_spec(), tmp_path)
    board = sweep.plan([make_spec()], tmp_path, workers=1, retry_failed=True)
    sweep.execute(board, LocalExecutor(tmp_path, 1), Silent(board))
    assert content(record.path) == before


@pytest.mark.parametrize("more", [(), ("--dry-run",)])
@pytest.mark.parametrize("below", [".", "deep/below"])
def test_a_results_path_that_can_be_no_folder_is_refused_before_anything_runs(
    fakes: Path, tmp_path: Path, bench: Bench, monkeypatch: pytest.MonkeyPatch, below: str, more: tuple[str, ...]
) -> None:
    monkeypatch.setattr(LocalExecutor, "execute", lambda *_: pytest.fail("it runs"))
    file = tmp_path / "notes.txt"
    file.write_text("mine")
    result = bench("run", "--algo", "fake-scripted", "--results", file / below, *more)
    assert result.exit_code == 2
    assert (
        result.stderr
        == f"bench: --results {file / below}: {file} is not a folder; give another name, or move it away.\n"
    )
    assert file.read_text() == "mine"


@pytest.mark.parametrize(("number", "says"), [(28, "No space left on device"), (30, "Read-only file system")])
def test_a_leaderboard_that_cannot_be_written_does_not_withhold_the_table(
    fakes: Path, tmp_path: Path, make_record: MakeRecord, bench: Bench, monkeypatch: pytest.MonkeyPatch,
    number: int, says: str,
) -> None:  # fmt: skip
    make_record(tmp_path, steps=4_000, eval_episodes=64)

    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(atomic, "write_file", refuse)
    result = bench("run", "--algo", "fake-learner", "--protocol", "smoke", "--results", tmp_path)
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines()[2].split()[:4] == ["a-v1", "fake-learner", "T", "1"]
    assert "leaderboard.md" not in result.stdout
    line = result.stderr.splitlines()[-1]
    assert line.startswith(f"bench: the leaderboard was not written: {tmp_path}: {says}: make room")
    assert line.endswith(f"bench leaderboard --results {tmp_path}")


def _empty(path: Path) -> None:
    path.write_bytes(b"")


def _halve(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("DONE", _empty),
        ("run.json", _halve),
        ("eval_episodes.parquet", _halve),
        ("eval_episodes.parquet", Path.unlink),
        ("train_episodes.parquet", Path.unlink),
    ],
)
def test_a_damaged_record_is_a_failed_run_before_anything_trains_and_withholds_no_other(
    fakes: Path, tmp_path: Path, make_record: MakeRecord, bench: Bench, name: str, damage: Callable[[Path], None]
) -> None:
    bad, good = (make_record(tmp_path, seed=seed, steps=4_000, eval_episodes=64) for seed in range(2))
    damage(bad / name)
    before = content(bad) | content(good)
    arguments = ("run", "--algo", "fake-learner", "--protocol", "smoke", "--seeds", "2", "--results", tmp_path)
    for more in ((), ("--retry-failed",)):
        result = bench(*arguments, *more, "--json")
        assert result.exit_code == 1
        printed = json.loads(result.stdout)
        assert [run["state"] for run in printed["runs"]] == ["failed", "done before"]
        assert {row["seeds"] for row in printed["results"]} == {1}
    assert content(bad) | content(good) == before
    for shown in (result.stdout, bench(*arguments).stdout, bench(*arguments, "--dry-run").stdout):
        assert f"{bad.name}/{name}" in shown
        assert f"Folder: {bad}" in shown
        assert "FAILED" not in shown


def test_a_failure_that_cannot_be_read_is_a_failed_run_and_can_be_tried_again(
    fakes: Path, tmp_path: Path, make_spec: Make
) -> None:
    with contextlib.suppress(RunFailedError):
        run(make_spec(method="fake-failing"), tmp_path)
    spec = make_spec(method="fake-failing")
    folder = Store(tmp_path).folder(spec)
    for damaged in ("", "{}"):
        (folder / "FAILED").write_text(damaged)
        (status,) = sweep.plan([spec], tmp_path, workers=1).runs
        assert status.phase is Phase.FAILED
        assert status.reason.endswith(f"Folder: {folder}")
    (status,) = sweep.plan([spec], tmp_path, workers=1, retry_failed=True).runs
    assert status.phase is Phase.QUEUED


def test_a_record_that_is_damaged_while_others_run_withholds_none(tmp_path: Path, make_record: MakeRecord) -> None:
    bad, good = make_record(tmp_path), make_record(tmp_path, seed=1)
    board = sweep.plan([read_record(path).spec for path in (bad, good)], tmp_path, workers=1)
    assert board.count(Phase.SKIPPED) == 2
    _halve(bad / "eval_episodes.parquet")
    finished = sweep.finish(board, tmp_path)
    assert [run.reason.endswith(f"Folder: {bad}") for run in finished.failed] == [True]
    assert {row["seeds"] for row in finished.rows} == {1}


def test_a_run_that_is_worked_on_elsewhere_is_no_failure(
    fakes: Path, tmp_path: Path, make_spec: Make, bench: Bench
) -> None:
    with Store(tmp_path).begin(make_spec(steps=4_000, eval_episodes=64)):
        result = bench("run", "--algo", "fake-learner", "--protocol", "smoke", "--results", tmp_path, "--workers", "1")
    assert result.exit_code == 0, result.output
    assert "not run here: fake-learner on a-v1, seed 0: " in result.stdout
    assert f"process {os.getpid()}" in result.stdout

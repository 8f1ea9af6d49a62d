"""Runs on worker processes: none stops another, not even by dying; Ctrl-C stops all at once and cleanly."""

import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
from rich.console import Console

from bench import sweep
from bench.display import Lines, LiveTable, Silent, cells
from bench.errors import LockedError
from bench.executors import LocalExecutor, death
from bench.fork_server import deaf_to_interrupts
from bench.lock import LOCK_NAME
from bench.progress import Board, Phase, RunStatus, duration
from bench.spec import RunSpec
from bench.store import State, Store

Make = Callable[..., RunSpec]


def test_a_failing_a_dying_and_a_locked_run_stop_nobody_kill(
    fakes: Path, tmp_path: Path, make_spec: Make, capsys: pytest.CaptureFixture[str]
) -> None:
    results = tmp_path / "results"
    dying, failing, last = make_spec(method="fake-dying"), make_spec(method="fake-failing"), make_spec(seed=2)
    locked = make_spec(seed=1)
    board = sweep.plan([dying, failing, locked, last], results, workers=1)
    with Store(results).begin(locked):
        sweep.execute(board, LocalExecutor(results, 1), Lines(board))
    assert [run.phase for run in board.runs] == [Phase.FAILED, Phase.FAILED, Phase.ELSEWHERE, Phase.DONE]
    assert "was killed by SIGKILL" in board.runs[0].reason
    assert "step 240 (train): RuntimeError: the learner tripped" in board.runs[1].reason
    assert f"process {os.getpid()}" in board.runs[2].reason
    failure = Store(results).failure(dying)
    assert failure is not None
    assert failure.stage == "worker"
    assert Store(results).state(last) is State.DONE
    assert "done: fake-learner on a-v1, seed 2" in capsys.readouterr().err
    assert (results / "logs").exists(), "a failed run keeps what it printed"

    again = sweep.plan([dying, failing, locked, last], results, workers=1)
    assert [run.phase for run in again.runs] == [Phase.FAILED, Phase.FAILED, Phase.QUEUED, Phase.SKIPPED]
    retried = sweep.plan([dying, failing], results, workers=1, retry_failed=True)
    assert [run.phase for run in retried.runs] == [Phase.QUEUED, Phase.QUEUED]


def _bench(results: Path, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "bench", "run", "--results", str(results), *arguments]
    # A test run that was started in the background of a shell ignores Ctrl-C, and its children would, too.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return subprocess.Popen(
            command, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
        )
    finally:
        signal.signal(signal.SIGINT, before)


def test_ctrl_c_stops_cleanly_and_says_how_to_go_on_and_a_second_bench_run_keeps_off(
    fakes: Path, tmp_path: Path, make_spec: Make
) -> None:
    results, sign = tmp_path / "results", tmp_path / "sign"
    endless = make_spec(method="fake-endless", steps=100_000, eval_episodes=4)
    process = _bench(
        results,
        "--algo",
        "fake-endless",
        "--scenario",
        "a",
        "--steps",
        "100000",
        "--eval-episodes",
        "4",
        "--seeds",
        "3",
    )
    try:
        deadline = time.monotonic() + 120.0
        while not sign.exists() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.1)
        assert sign.exists()
        assert Store(results).state(endless) is State.RUNNING
        with pytest.raises(LockedError), Store(results).begin(endless):
            pass
        start = time.monotonic()
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the whole group
        process.wait(timeout=60)
        seconds = time.monotonic() - start
        _, err = process.communicate(timeout=60)
    finally:
        process.kill()
    # 5 s on a machine that is free; a loaded one is given more here.
    assert seconds < 15.0
    assert process.returncode == 130
    assert "stopped with 0 of 3 runs done" in err
    assert "The same command goes on" in err
    assert "Traceback" not in err
    assert Store(results).state(endless) is State.UNFINISHED
    assert not list(results.rglob(LOCK_NAME))


@pytest.mark.parametrize("delay_s", [0.0, 0.1, 0.2, 0.7, 1.5])
def test_ctrl_c_while_workers_are_being_started_is_not_lost(tmp_path: Path, delay_s: float) -> None:
    process = _bench(tmp_path, "--algo", "sac", "--scenario", "a", "--protocol", "quick", "--quiet")
    try:
        while not psutil.Process(process.pid).children() and process.poll() is None:
            time.sleep(0.01)
        time.sleep(delay_s)  # it parses, plans, waits for what workers are forked from
        os.killpg(process.pid, signal.SIGINT)
        start = time.monotonic()
        _, err = process.communicate(timeout=60)  # until nobody may write any more
        seconds = time.monotonic() - start
    finally:
        process.kill()
    assert process.returncode == 130
    assert seconds < 15.0  # 0.1 s on a machine that is free
    assert "Traceback" not in err
    assert "The same command goes on" in err


def test_ctrl_c_when_all_is_done_changes_nothing() -> None:
    code = """
import atexit, os, signal, bench.cli
atexit.register(print, "the end", flush=True)
atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))
atexit.register(bench.cli._end)
"""
    done = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "the end\n", "")


def test_an_interrupt_in_the_middle_of_an_import_ends_with_130_too(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "import sys, bench.cli\n"
        "def main():\n"
        "    try:\n"
        "        exec('raise KeyboardInterrupt')  # as a dataclass that is being made\n"
        "    except KeyboardInterrupt:\n"
        "        sys.exit(130)\n"
        "bench.cli.main = main\n"
    )
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    assert subprocess.run([sys.executable, "-m", "bench"], env=environment, timeout=60).returncode == 130


def _interrupt_both(command: list[str]) -> None:
    with deaf_to_interrupts():
        child = subprocess.Popen(command)
        child.send_signal(signal.SIGINT)
        # To this thread: another one, of a library, would take it at once.
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)
        assert child.wait(timeout=30) == 0


def test_children_started_deaf_do_not_hear_ctrl_c_and_the_parent_hears_it_afterwards() -> None:
    sleep = [sys.executable, "-c", "import time; time.sleep(1.0)"]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            _interrupt_both(sleep)
    finally:
        signal.signal(signal.SIGINT, before)


def test_workers_and_their_pins_are_gone_afterwards(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    affinity = os.sched_getaffinity(0)
    environment = dict(os.environ)
    board = sweep.plan([make_spec(seed=seed) for seed in range(2)], tmp_path, workers=2)
    sweep.execute(board, LocalExecutor(tmp_path, 2), Silent(board))
    assert board.count(Phase.DONE) == 2
    assert os.sched_getaffinity(0) == affinity
    assert dict(os.environ) == environment
    assert threading.active_count() == 1 or not any("bench" in thread.name for thread in threading.enumerate())
    assert not (tmp_path / "logs").exists()


def test_the_live_table_shows_every_phase_without_reading_names_as_markup(make_spec: Make) -> None:
    phases = list(Phase)
    runs = [RunStatus(make_spec(seed=i, method="x:[red]=1"), phase) for i, phase in enumerate(phases)]
    runs[phases.index(Phase.RUNNING)].start(os.getpid())
    runs[phases.index(Phase.RUNNING)].advance("train", 500, 2_000, {"collision_rate": 0.25})
    board = Board(runs, workers=2)
    table = LiveTable(board)
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(table._draw())
    text = console.export_text()
    assert "x:[red]=1 on a-v1, seed 1" in text
    assert "train 25 %" in text
    assert "25.0 %" in text
    assert "MiB" in text
    assert "2/6 done" in text


def test_what_a_resumed_stage_went_on_from_is_not_in_its_rate(make_spec: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    run = RunStatus(make_spec())
    run.start(os.getpid())
    run.advance("train", 80_000, 100_000, {})
    now += 10.0
    assert run.rate == 0.0
    assert run.eta_s is None
    assert cells(run)[:3] == ("train 80 %", "", "")
    run.advance("train", 84_000, 100_000, {})
    assert run.rate == pytest.approx(400.0)
    assert run.eta_s == pytest.approx(40.0)
    run.start(os.getpid())  # another node: it goes on from a checkpoint
    run.advance("train", 82_000, 100_000, {})
    now += 10.0
    assert run.rate == 0.0


@pytest.mark.parametrize(("stage", "text"), [("risk model", "6 epochs/min"), ("evaluate", "0 episodes/s")])
def test_a_slow_stage_has_a_rate_that_can_be_read(make_spec: Make, stage: str, text: str) -> None:
    run = RunStatus(make_spec(), _stage_started=time.monotonic() - 30.0)
    run.phase, run.pid, run.stage, run.done, run.total = Phase.RUNNING, os.getpid(), stage, 3, 15
    assert cells(run)[1] == text


def test_the_time_left_comes_from_runs_of_the_same_method(make_spec: Make) -> None:
    runs = [RunStatus(make_spec(seed=i)) for i in range(3)]
    board = Board(runs, workers=2)
    assert board.eta_s() is None
    runs[0].phase, runs[0].seconds = Phase.DONE, 10.0
    assert board.eta_s() == pytest.approx(10.0)


def test_the_time_left_is_not_less_than_that_of_the_stage_that_takes_longest(make_spec: Make) -> None:
    # One run has ended after 10 s; another trains a risk model, 3 of 15 epochs in 30 s: 120 s more.
    done = RunStatus(make_spec(), Phase.DONE, seconds=10.0)
    now = time.monotonic()
    slow = RunStatus(
        make_spec(seed=1), Phase.RUNNING, "risk model", 3, 15, _started=now - 60.0, _stage_started=now - 30.0
    )
    assert Board([done, slow], workers=2).eta_s() == pytest.approx(120.0, rel=0.01)


@pytest.mark.parametrize(
    ("code", "text"),
    [(-9, "was killed by SIGKILL (out of memory?)"), (-11, "was killed by SIGSEGV"), (3, "exit code 3")],
)
def test_the_death_of_a_process_is_described(code: int, text: str) -> None:
    assert text in death(code)


@pytest.mark.parametrize(("seconds", "text"), [(4.4, "4 s"), (200, "3 min 20 s"), (7500, "2 h 05 min")])
def test_durations_are_readable(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.slow
def test_a_sweep_of_24_runs_on_two_cores_takes_at_most_1_15_times_the_ideal_split(tmp_path: Path) -> None:
    start = time.monotonic()
    process = _bench(tmp_path, "--algo", "sac", "--protocol", "smoke", "--seeds", "24", "--workers", "2", "--json")
    out, err = process.communicate(timeout=3600)
    wall = time.monotonic() - start
    assert process.returncode == 0, err
    runs = json.loads(out)["runs"]
    assert [run["state"] for run in runs] == ["done"] * 24
    assert wall <= 1.15 * sum(run["seconds"] for run in runs) / 2

"""The process that workers are forked from: started before all else, gone with the command that started it."""

import os
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

HEAVY = ("numba", "numpy", "pydantic", "pyarrow", "stable_baselines3", "torch", "typer")


def _printed(code: str, *arguments: str) -> str:
    return subprocess.check_output([sys.executable, "-c", code, *arguments], text=True)


STARTED = f"""
import sys, bench.cli, bench.fork_server
def warm_up():
    print("forking", *sorted(set({HEAVY!r}) & set(sys.modules)), flush=True)
    raise SystemExit
bench.fork_server.warm_up = warm_up
bench.cli.main()
"""


def test_a_command_starts_it_before_anything_heavy_is_imported() -> None:
    assert _printed(STARTED, "run", "--algo", "sac").split() == ["forking"]


@pytest.mark.parametrize(
    "arguments", [["run", "-h"], ["run", "--dry-run"], ["run", "--executor=ray", "--address"], ["list", "--help"]]
)
def test_a_command_that_forks_no_workers_does_not_start_it(arguments: list[str]) -> None:
    done = subprocess.run([sys.executable, "-c", STARTED, *arguments], text=True, capture_output=True, check=False)
    assert "forking" not in done.stdout


def test_a_command_plans_and_reports_runs_of_every_method_without_torch_or_numba(tmp_path: Path) -> None:
    code = f"""
import sys
from pathlib import Path
from bench import executors, run_command
from bench.protocols import Request
executors.warm_up = lambda: None
executors.LocalExecutor.execute = lambda *_: print("executed", file=sys.stderr)
options = run_command.Options(Path({str(tmp_path)!r}), 2, False, True, False)
assert run_command.run(Request("all,dd-rq-plus", "a,b"), options) == 0
print(*sorted({{"numba", "stable_baselines3", "torch"}} & set(sys.modules)))
"""
    assert _printed(code).splitlines()[-1] == ""


def test_it_looks_for_no_garbage_in_what_it_imports_and_takes_nothing_down_at_its_end() -> None:
    code = """
import atexit, gc
import bench.fork_server  # what that process consists of before its imports
collections = []
gc.callbacks.append(lambda *_: collections.append(1))
atexit.register(print, "taken down", flush=True)
import bench.preload
print(len(collections) < 10, gc.isenabled(), gc.get_freeze_count() > 100_000, flush=True)
"""
    assert _printed(code).splitlines() == ["True True True"]


def test_a_command_looks_for_no_garbage_at_its_end() -> None:
    code = """
import atexit, gc, bench.cli
atexit.register(lambda: print(gc.get_freeze_count() > 0, flush=True))
bench.cli.main()
"""
    assert _printed(code, "list", "--json").splitlines()[-1] == "True"


def test_nothing_is_left_of_a_command_that_ends_early(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "bench", "run", "--algo", "sak", "--results", str(tmp_path)]
    with subprocess.Popen(
        command, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    ) as process:
        process.wait(timeout=60)
        ended = time.monotonic()
        _, err = process.communicate(timeout=60)  # its reader waits for all that may still write
    assert process.returncode == 2
    assert "sak" in err
    while _lives(process.pid) and time.monotonic() < ended + 2.0:  # the imports that it was at take longer
        time.sleep(0.02)
    assert not _lives(process.pid)


def _lives(group: int) -> bool:
    """Whether a process of the group still runs: one that only waits for init to bury it does not."""
    found = [process.info for process in psutil.process_iter(["pid", "status"])]
    return any(_group(info["pid"]) == group for info in found if info["status"] != psutil.STATUS_ZOMBIE)


def _group(pid: int) -> int | None:
    try:
        return os.getpgid(pid)
    except ProcessLookupError:
        return None

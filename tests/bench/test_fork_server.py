"""The process that workers are forked from: started before all else, gone with the command that started it."""

import os
import subprocess
import sys
import time
from pathlib import Path

HEAVY = ("numba", "numpy", "pydantic", "pyarrow", "torch")


def test_a_command_starts_it_before_anything_heavy_is_imported() -> None:
    code = f"import sys, bench.cli, bench.fork_server; print(*sorted(set({HEAVY!r}) & set(sys.modules)))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).split() == []


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
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True

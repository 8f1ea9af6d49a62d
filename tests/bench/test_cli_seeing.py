"""Commands that show: exit codes, JSON, files, completion, and a light start."""

import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from tests.bench.policy_records import reference_policy, write_record

ROOT = Path(__file__).resolve().parents[2]
HELP_CPU_S = 0.5


def test_replay_prints_json_and_writes_a_page(tmp_path: Path, bench: Callable[..., Result]) -> None:
    write_record(tmp_path, "cruise", reference_policy("cruise"), episodes=2)
    out = tmp_path / "x.html"
    result = bench("replay", "cruise", "--episode", "1", "--results", tmp_path, "--out", out, "--json")
    assert result.exit_code == 0, result.output
    (shown,) = json.loads(result.stdout)
    assert (shown["title"], shown["episode"], shown["exact"]) == ("cruise on a-v1, seed 0", 1, True)
    assert "Replays.Player" in out.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("nobody",), "no folder with this in its name"),
        (("cruise", "--episode", "2"), "a number from 0 to 1"),
        (("cruise", "--out", "x.avi"), "the suffix must be one of .mp4, .gif, .png, .html"),
        (("cruise", "--out", "missing/x.mp4"), "there is no folder"),
        (("stress:a", "--episode", "worst"), "bench stress guard prints those"),
        (("stress:a:tc=slow", "--episode", "1"), "Expected a name such as stress:a:tc=3.0:driver=random"),
        (("stress:a:tc=", "--episode", "1"), "A key has no value"),
        (("stress:nowhere", "--episode", "1"), "nowhere"),
        (("stress:a:driver=nobody", "--episode", "1"), "nobody"),
        (("stress:a", "--episode", "1", "--against", "stress:b"), "share no episodes"),
    ],
)
def test_what_cannot_be_shown_ends_with_code_2(
    arguments: tuple[str, ...], says: str, tmp_path: Path, bench: Callable[..., Result]
) -> None:
    write_record(tmp_path, "cruise", reference_policy("cruise"), episodes=2)
    result = bench("replay", *arguments, "--results", tmp_path)
    assert result.exit_code == 2, result.output
    assert says in result.stderr
    assert result.stdout == ""


def test_a_replay_that_differs_ends_with_code_1(tmp_path: Path, bench: Callable[..., Result]) -> None:
    write_record(tmp_path, "cruise", reference_policy("cruise"), episodes=2, change={(0, "steps"): 5})
    result = bench("replay", "cruise", "--episode", "0", "--results", tmp_path)
    assert result.exit_code == 1
    assert "It is not shown" in result.stderr


def test_report_says_what_it_wrote(
    tmp_path: Path, make_record: Callable[..., Path], bench: Callable[..., Result]
) -> None:
    make_record(tmp_path)
    result = bench("report", "--out", tmp_path / "deep" / "er", "--results", tmp_path, "--json")
    assert result.exit_code == 0, result.output
    written = json.loads(result.stdout)
    path = tmp_path / "deep" / "er" / "index.html"
    assert written == {"path": str(path), "bytes": path.stat().st_size, "runs": 1}
    assert "1 runs" in bench("report", "--out", tmp_path / "out", "--results", tmp_path, "--quiet").stdout
    assert bench("report", "--results", tmp_path).exit_code == 2


def complete(words: str, folder: Path) -> list[str]:
    """What the shell would offer for the last of the words."""
    variables = {"_BENCH_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
    done = subprocess.run(
        [sys.executable, "-m", "bench"], cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT), **variables},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout.split()


def test_the_shell_completes_commands_and_runs(tmp_path: Path) -> None:
    (tmp_path / "results" / "runs" / "a-v1_cruise_s0_0123456789ab").mkdir(parents=True)
    assert complete("bench rep", tmp_path) == ["replay", "report"]
    assert complete("bench replay a-", tmp_path) == ["a-v1_cruise_s0_0123456789ab"]


def test_help_starts_light() -> None:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "bench", "--help"], cwd=ROOT, capture_output=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < HELP_CPU_S

"""The command line: exit codes, shapes of JSON, messages without tracebacks."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

MakeRecord = Callable[..., Path]


def test_python_m_bench_prints_its_help_and_every_command() -> None:
    done = subprocess.run([sys.executable, "-m", "bench", "--help"], capture_output=True, text=True, check=True)
    for command in ("run", "list", "leaderboard", "tables", "claims", "plot", "why", "speed", "doctor"):
        assert f"\n  {command} " in done.stdout


def test_unknown_names_end_with_code_2_and_a_suggestion_on_standard_error() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "bench", "run", "--algo", "sack", "--scenario", "a"], capture_output=True, text=True
    )
    assert done.returncode == 2
    assert "Did you mean sac" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize(
    "arguments",
    [
        ("rum",),
        ("run", "--protocl", "smoke"),
        ("run", "--algo", "cruise", "--scenario", "c"),
        ("run", "--algo", "cruise", "--protocol", "smok"),
        ("run", "--algo", "cruise", "--seeds", "x"),
        ("run", "--algo", "cruise", "--steps", "many"),
        ("run", "--algo", "sac", "--steps", "4001"),
        ("run", "--algo", "cruise", "--workers", "0"),
        ("run", "--algo", "cruise", "--set", "cost.limt=1"),
        ("speed", "engine", "--scenario", "aa"),
    ],
)
def test_what_cannot_be_meant_ends_with_code_2(bench: Callable[..., Result], arguments: tuple[str, ...]) -> None:
    result = bench(*arguments)
    assert result.exit_code == 2, result.output
    assert result.stderr


def test_list_names_methods_and_scenarios(fakes: Path, bench: Callable[..., Result]) -> None:
    listed = json.loads(bench("list", "--json").stdout)
    methods = {method["name"]: method for method in listed["methods"]}
    assert all(set(method) == {"name", "available", "reason", "origin"} for method in listed["methods"])
    assert methods["sac"]["available"] is True
    assert methods["broken"]["available"] is False
    assert "fake_methods_that_are_not_there" in methods["broken"]["reason"]
    scenarios = {scenario["name"]: scenario for scenario in listed["scenarios"]}
    assert scenarios["a"]["id"] == "a-v1"
    assert scenarios["b"]["gymnasium_id"] == "bench/MixedTraffic-v1"
    text = bench("list").stdout
    assert "fake-learner" in text
    assert "bench/MixedTraffic-v1" in text


def test_a_run_prints_t_and_a_with_honest_intervals_and_is_skipped_the_second_time(
    fakes: Path, tmp_path: Path, bench: Callable[..., Result]
) -> None:
    arguments = ("run", "--algo", "fake-learner,fake-scripted", "--scenario", "a", "--protocol", "smoke")
    result = bench(*arguments, "--results", tmp_path, "--workers", "1", "--quiet")
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert [line.split()[:3] for line in lines[2:5]] == [
        ["a-v1", "fake-learner", "T"],
        ["a-v1", "fake-learner", "A"],
        ["a-v1", "fake-scripted", "A"],
    ]
    assert f"Records: {tmp_path / 'runs'}" in lines[-1]
    assert len((tmp_path / "leaderboard.csv").read_text().splitlines()) == 1 + 3
    again = json.loads(bench(*arguments, "--results", tmp_path, "--json").stdout)
    assert {run["state"] for run in again["runs"]} == {"done before"}
    assert {row["stage"] for row in again["results"]} == {"T", "A"}
    assert again["unavailable"] == {}


def test_a_failed_run_ends_with_code_1_and_the_rest_is_printed(
    fakes: Path, tmp_path: Path, bench: Callable[..., Result]
) -> None:
    result = bench(
        "run", "--algo", "fake-failing,fake-scripted", "--protocol", "smoke", "--results", tmp_path, "--workers", "1",
        "--json",
    )  # fmt: skip
    assert result.exit_code == 1
    printed = json.loads(result.stdout)
    assert {run["method"]: run["state"] for run in printed["runs"]} == {
        "fake-failing": "failed",
        "fake-scripted": "done",
    }
    assert "the learner tripped" in printed["runs"][0]["reason"]
    assert [row["method"] for row in printed["results"]] == ["fake-scripted"]
    repeated = bench("run", "--algo", "fake-failing", "--protocol", "smoke", "--results", tmp_path)
    assert repeated.exit_code == 1
    assert "--retry-failed tries again" in repeated.stdout


def test_a_dry_run_lists_the_runs_and_makes_nothing(
    fakes: Path, tmp_path: Path, bench: Callable[..., Result], make_record: MakeRecord
) -> None:
    make_record(tmp_path, seed=0, steps=4_000, eval_episodes=64)
    before = sorted(tmp_path.rglob("*"))
    arguments = ("run", "--algo", "fake-learner", "--protocol", "smoke", "--seeds", "3", "--results", tmp_path)
    listed = json.loads(bench(*arguments, "--dry-run", "--json").stdout)
    assert [run["state"] for run in listed["runs"]] == ["done before", "queued", "queued"]
    # The record took 2 s of processor time to train and none to evaluate.
    assert [run["seconds"] for run in listed["runs"]] == [0.0, 2.0, 2.0]
    assert "2 of 2 runs at rates measured" in listed["basis"]
    assert "2 of 3 runs to do" in bench(*arguments, "--dry-run").stdout
    assumed = bench("run", "--algo", "sac", "--protocol", "smoke", "--results", tmp_path, "--dry-run").stdout
    assert "assumed" in assumed
    assert sorted(tmp_path.rglob("*")) == before


def test_a_record_that_cannot_be_read_is_named_and_left_out_of_the_estimate(
    fakes: Path, tmp_path: Path, bench: Callable[..., Result], make_record: MakeRecord
) -> None:
    make_record(tmp_path, seed=0, steps=4_000, eval_episodes=64)
    damaged = make_record(tmp_path, seed=1, steps=4_000, eval_episodes=64)
    (damaged / "run.json").write_text("{")
    make_record(tmp_path, method="other", method_version=1)
    make_record(tmp_path, method="other", method_version=2)  # share no table, but can be read
    arguments = ("--protocol", "smoke", "--seeds", "7,", "--results", tmp_path, "--dry-run", "--json")
    result = bench("run", "--algo", "fake-learner", *arguments)
    assert [run["seconds"] for run in json.loads(result.stdout)["runs"]] == [2.0]
    (line,) = result.stderr.splitlines()
    assert f"left out of the estimate: {damaged.name}/run.json is truncated or damaged" in line


def test_what_is_unavailable_is_named_and_stops_no_other(
    fakes: Path, tmp_path: Path, bench: Callable[..., Result]
) -> None:
    arguments = ("--protocol", "smoke", "--results", tmp_path, "--dry-run")
    result = bench("run", "--algo", "broken,fake-scripted", *arguments)
    assert "unavailable: broken:" in result.stderr
    assert "1 of 1 runs to do" in result.stdout
    assert "unavailable" not in bench("run", "--algo", "all", *arguments).stderr
    assert bench("run", "--algo", "broken", *arguments).exit_code == 2


def test_leaderboard_and_tables_refuse_bad_records_with_code_1(
    tmp_path: Path, bench: Callable[..., Result], make_record: MakeRecord
) -> None:
    path = make_record(tmp_path)
    (path / "run.json").write_text("{")
    for command in ("leaderboard", "tables"):
        result = bench(command, "--results", tmp_path)
        assert result.exit_code == 1
        assert path.name in result.stderr
    assert not list(tmp_path.glob("*.csv"))


def test_tables_of_other_results_go_beside_them(
    tmp_path: Path, bench: Callable[..., Result], make_record: MakeRecord
) -> None:
    make_record(tmp_path)
    result = bench("tables", "--results", tmp_path)
    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "paper_tables").iterdir()} == {
        f"{table}.{suffix}" for table in ("ablation", "collision") for suffix in ("md", "tex", "csv")
    }
    result = bench("tables", "--results", tmp_path, "--out", tmp_path / "elsewhere", "--json")
    assert str(tmp_path / "elsewhere" / "ablation.md") in json.loads(result.stdout)
    assert (tmp_path / "elsewhere" / "ablation.md").exists()


def test_runs_without_a_record_are_named_beside_what_is_drawn_without_them(
    tmp_path: Path, bench: Callable[..., Result], make_record: MakeRecord
) -> None:
    make_record(tmp_path)
    assert bench("leaderboard", "--results", tmp_path).stderr == ""
    (make_record(tmp_path, seed=1) / "DONE").unlink()
    result = bench("leaderboard", "--results", tmp_path, "--json")
    assert {row["seeds"] for row in json.loads(result.stdout)} == {1}
    assert "left out, fake-learner on a-v1, seed 1: unfinished" in result.stderr


def test_doctor_reports_and_fails_only_where_something_required_is_broken(
    fakes: Path, tmp_path: Path, bench: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    result = bench("doctor", "--results", tmp_path, "--json")
    report = json.loads(result.stdout)
    assert (report["healthy"], result.exit_code) == (True, 0)
    checks = {check["name"]: check for check in report["checks"]}
    assert checks["engine"]["ok"]
    assert checks["method broken"] | {"found": ""} == {
        "name": "method broken",
        "ok": False,
        "required": False,
        "found": "",
        "remedy": "optional; the reason says what helps",
    }
    monkeypatch.setattr("bench.doctor.DISK_MIN_GIB", 1e9)
    broken = bench("doctor", "--results", tmp_path)
    assert broken.exit_code == 1
    assert "BROKEN" in broken.stdout
    assert "choose another folder with --results" in broken.stdout


def test_the_doctor_survives_what_it_finds(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from bench import doctor

    def explode() -> list[doctor.Check]:
        raise ImportError("libnothing.so: cannot open")

    monkeypatch.setattr(doctor, "_kernels", explode)
    broken = [check for check in doctor.examine(tmp_path) if not check.ok and check.required]
    assert [check.found for check in broken] == ["ImportError: libnothing.so: cannot open"]


@pytest.mark.slow
def test_speed_engine_prints_the_names_that_others_rely_on(
    bench: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bench.speed.engine.MEASURED_S", 0.02)
    monkeypatch.setattr("bench.speed.engine.ORACLE_S", 0.02)
    result = bench("speed", "engine", "--worlds", "16", "--repeats", "5", "--json")
    assert result.exit_code == 0, result.output
    measured = json.loads(result.stdout)
    assert {"scenario", "worlds", "decision_period_s", "world_steps_per_s", "highway_env_steps_per_s",
            "ratio_vs_highway_env", "two_thread_scaling", "world_steps_per_s_two_threads", "first_step_s"} <= set(
        measured
    )  # fmt: skip
    assert measured["ratio_vs_highway_env"] == pytest.approx(
        measured["world_steps_per_s"] / measured["highway_env_steps_per_s"]
    )


def test_the_meter_counts_only_steps_that_were_simulated() -> None:
    from bench.speed.engine import Meter
    from envs.scenario import get_scenario

    meter = Meter.build(get_scenario("a"), 8, threads=1)
    meter.env.reset(seed=3)
    meter.next = 0
    before = meter.simulated()
    rate = meter.repeat(0.05)
    counted = meter.simulated() - before
    # Worlds that end within a decision do not simulate the rest of it.
    assert 0 < counted <= meter.next * 8 * 5
    assert rate.wall > 0.0
    assert rate.cpu > 0.0


@pytest.mark.parametrize("setting", ["batch=-3", "decisions_per_update=0", "learning_rate=nan", "tau=2"])
def test_a_setting_that_cannot_train_is_refused_before_anything_runs(
    tmp_path: Path, bench: Callable[..., Result], setting: str
) -> None:
    result = bench("run", "--algo", "sac", "--set", f"sac.{setting}", "--protocol", "smoke", "--results", tmp_path)
    assert result.exit_code == 2
    assert setting.replace("=", " = ").split(".")[0][:8] in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["leaderboard", "tables", "claims", "plot"])
def test_a_results_folder_without_runs_is_refused_and_not_made(
    tmp_path: Path, bench: Callable[..., Result], command: str
) -> None:
    result = bench(command, "--results", tmp_path / "mistyped")
    assert result.exit_code == 2
    assert "mistyped: no runs there" in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_tables_of_a_budget_that_nobody_ran_are_refused(
    tmp_path: Path, bench: Callable[..., Result], make_record: MakeRecord
) -> None:
    make_record(tmp_path, steps=2_000)
    result = bench("tables", "--results", tmp_path, "--steps", "7")
    assert result.exit_code == 2
    assert "there are: [2000]" in result.stderr
    assert not (tmp_path / "paper_tables").exists()

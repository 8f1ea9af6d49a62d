"""What others add: the skeleton of bench new-method, and the example distribution, installed as a user would."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from bench.cli.commands import app
from bench.new_method import new_method

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def bench() -> Callable[..., Result]:
    def call(*arguments: object) -> Result:
        return CliRunner().invoke(app, [str(argument) for argument in arguments])

    return call


def python(site: Path, *arguments: object) -> str:
    """Output of this Python, with a folder of installed packages, in the project."""
    environment = {**os.environ, "PYTHONPATH": f"{site}{os.pathsep}{ROOT}", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, *map(str, arguments)]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return done.stdout


def install(source: Path, site: Path) -> None:
    """pip installs a copy of a package into a folder, without network."""
    copy = site.parent / f"{source.name}-source"
    shutil.copytree(source, copy)
    arguments = ("--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check", "--quiet")
    python(site, "-m", "pip", "install", *arguments, "--target", site, copy)


def test_the_skeleton_is_named_throughout(tmp_path: Path, bench: Callable[..., Result]) -> None:
    made = bench("new-method", "so-new", "--out", tmp_path / "deep", "--json")
    assert json.loads(made.stdout) == {"method": "so-new", "folder": str(tmp_path / "deep" / "so-new")}
    assert "bench check so-other" in bench("new-method", "so-other", "--out", tmp_path).stdout
    folder = tmp_path / "deep" / "so-new"
    assert {path.name for path in folder.iterdir()} == {"pyproject.toml", "so_new.py", "test_so_new.py"}
    for path in folder.iterdir():
        text = path.read_text()
        assert "so-new" in text
        assert "my" not in text.lower().replace("mypy", "")
    assert 'so-new = "so_new:SoNew"' in (folder / "pyproject.toml").read_text()
    compile((folder / "so_new.py").read_text(), "so_new.py", "exec")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sac", "is taken"),
        ("My-Method", "small letters"),
        ("my_method", "small letters"),
        ("my--method", "small letters"),
        ("1st", "small letters"),
        ("../up", "small letters"),
        ("random+guard", "small letters"),
        ("x:y=1", "small letters"),
        ("", "small letters"),
        ("json", "already has a module 'json'"),
        ("class", "already has a module 'class'"),
    ],
)
def test_a_bad_name_is_refused_with_a_remedy(
    tmp_path: Path, bench: Callable[..., Result], name: str, message: str
) -> None:
    result = bench("new-method", name, "--out", tmp_path)
    assert result.exit_code == 2
    assert message in result.stderr
    assert not list(tmp_path.iterdir())


def test_an_existing_folder_is_left_alone(tmp_path: Path, bench: Callable[..., Result]) -> None:
    (tmp_path / "so-new").mkdir()
    (tmp_path / "so-new" / "kept").touch()
    result = bench("new-method", "so-new", "--out", tmp_path)
    assert result.exit_code == 2
    assert "exists" in result.stderr
    assert [path.name for path in (tmp_path / "so-new").iterdir()] == ["kept"]


def test_the_barrier_worked_by_hand_and_the_guard_in_a_queue(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "examples" / "cbf")
    from safedrive_cbf.guard import BarrierGuard, barrier_acceleration

    # h = 50 - 36 - 2 = 12; (8 - 10 + 0.5 * 12) / 3.6.
    found = barrier_acceleration(np.array([[50.0]]), np.array([[10.0]]), np.array([[8.0]]))
    assert found == pytest.approx(4.0 / 3.6)

    from bench.stress import stress_guard

    for scenario in ("a", "b"):
        stress = stress_guard(scenario, 3.0, 100, "full-throttle", shield_factory=lambda _: BarrierGuard())
        assert stress.ego_at_fault == 0


@pytest.mark.slow
def test_the_skeleton_installs_passes_its_own_test_and_runs(tmp_path: Path) -> None:
    site = tmp_path / "site"
    folder = new_method("so-new", tmp_path / "made")
    install(folder, site)
    python(site, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--import-mode=importlib", folder / "test_so_new.py")
    python(site, "-m", "bench", "run", "--algo", "so-new", "--protocol", "smoke", "--results", tmp_path / "results")


@pytest.mark.slow
def test_the_example_adds_a_method_a_guard_and_a_scenario_by_entry_points_alone(tmp_path: Path) -> None:
    site = tmp_path / "site"
    install(ROOT / "examples" / "cbf", site)
    listed = json.loads(python(site, "-m", "bench", "list", "--json"))
    assert {"name": "cbf-search", "available": True, "reason": "", "origin": "safedrive_cbf.method:BarrierSearch"} in (
        listed["methods"]
    )
    assert "rush-hour" in {scenario["name"] for scenario in listed["scenarios"]}
    assert json.loads(python(site, "-m", "bench", "check", "cbf-search", "--json"))["passed"]
    request = ("--algo", "cbf-search", "--scenario", "rush-hour", "--protocol", "smoke", "--json")
    run = json.loads(python(site, "-m", "bench", "run", *request, "--results", tmp_path / "results"))
    assert [(row["state"], row["scenario"]) for row in run["runs"]] == [("done", "rush-hour-v1")]

"""The contract's checks: what keeps it passes, each way to break it is caught under its own name."""

import importlib
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from algorithms.registry import list_methods
from bench import contract
from bench.cli.commands import app
from bench.contract import checks
from bench.errors import UsageError

METHODS = Path(__file__).with_name("plugin_methods.py")
CLASSES = [
    line.split()[1].split("(")[0]
    for line in METHODS.read_text().splitlines()
    if line.startswith("class ") and "Policy(" not in line and "Guard" not in line
]


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The classes of plugin_methods.py as methods p-NAME of an installed package, and p-raising that does not load."""
    site = tmp_path / "site"
    info = site / "plugin_methods_for_tests-1.0.dist-info"
    info.mkdir(parents=True)
    (site / "plugin_methods_for_tests.py").write_text(METHODS.read_text())
    (site / "raising_for_tests.py").write_text("raise RuntimeError('no such licence')\n")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: plugin-methods-for-tests\nVersion: 1.0\n")
    points = [f"p-{name.lower()} = plugin_methods_for_tests:{name}" for name in CLASSES]
    points.append("p-raising = raising_for_tests:Method")
    (info / "entry_points.txt").write_text("\n".join(["[bench.methods]", *points, ""]))
    monkeypatch.syspath_prepend(site)
    monkeypatch.setenv("PYTHONPATH", f"{site}:{Path(__file__).resolve().parents[2]}")
    importlib.invalidate_caches()
    yield site
    for name in ("plugin_methods_for_tests", "raising_for_tests"):
        sys.modules.pop(name, None)


@pytest.fixture
def bench() -> Callable[..., Result]:
    def call(*arguments: object) -> Result:
        return CliRunner().invoke(app, [str(argument) for argument in arguments])

    return call


@pytest.mark.parametrize("name", ["learner", "heeding", "evolving", "scripted"])
def test_a_method_that_keeps_the_contract_passes_every_check(installed: Path, name: str) -> None:
    report = contract.check_method(f"p-{name}")
    assert [check.name for check in report.checks] == list(contract.NAMES)
    assert report.passed, report.as_json()


@pytest.mark.parametrize(
    ("name", "caught", "detail"),
    [
        ("raising", checks.AVAILABLE, "RuntimeError: no such licence"),
        ("tripping", checks.TRAINS, "RuntimeError: tripped"),
        ("greedy", checks.BUDGET, "budget of 50 decisions"),
        ("idle", checks.BUDGET, "3,920 of 4,000"),
        ("writing", checks.OBSERVATIONS, "copy them first"),
        ("writinginuse", checks.OBSERVATIONS, "at decision 0: copy them first"),
        ("nan", checks.FINITE, "nan as entry 0 for world 0 at decision 0"),
        ("wide", checks.SPACES, "gave 9 as entry 1 for world 0 at decision 0: outside [-2, 2]"),
        ("flat", checks.SPACES, "gave shape (2,) at decision 0: must be (16, 2)"),
        ("writingshield", checks.SHIELD, "filter() wrote into accelerations"),
        ("pickling", checks.SAVED, "save() wrote action.pkl"),
        ("forgetful", checks.SAVED, "other actions at decision 0"),
        ("unseeded", checks.DETERMINISM, "action.json differs in a second training"),
        ("heedless", checks.COST, "read info['cost']"),
        ("terminating", checks.TRUNCATION, "calling every truncation a termination changed nothing"),
        ("resetting", checks.TRUNCATION, "another info['final_obs'] changed nothing"),
    ],
)
def test_what_breaks_the_contract_is_caught_by_name(installed: Path, name: str, caught: str, detail: str) -> None:
    report = contract.check_method(f"p-{name}")
    found = {check.name: check for check in report.checks}
    assert not report.passed
    assert list(found) == list(contract.NAMES)
    assert not found[caught].passed
    assert detail in found[caught].detail
    others = [check for check in report.checks if not check.passed and check.name != caught]
    assert all("not reached" in check.detail for check in others), others


def test_check_prints_the_report_and_fails_with_code_1(installed: Path, bench: Callable[..., Result]) -> None:
    good = bench("check", "p-learner", "--json")
    assert good.exit_code == 0, good.output
    printed = json.loads(good.stdout)
    assert set(printed) == {"method", "passed", "checks"}
    assert (printed["method"], printed["passed"]) == ("p-learner", True)
    assert all(set(check) == {"name", "passed", "detail"} for check in printed["checks"])
    bad = bench("check", "p-tripping")
    assert bad.exit_code == 1
    assert "FAILED  trains" in bad.stdout
    assert "p-tripping does not keep the contract" in bad.stdout


def test_an_unknown_name_is_a_usage_error(installed: Path, bench: Callable[..., Result]) -> None:
    with pytest.raises(UsageError, match="Did you mean p-learner"):
        contract.check_method("p-lerner")
    assert bench("check", "p-learner:x=1").exit_code == 2


def test_bad_plugins_fail_by_name_and_stop_nobody_else(
    installed: Path, tmp_path: Path, bench: Callable[..., Result]
) -> None:
    bad = {
        "p-raising": "no such licence",
        "p-nan": "Action entry 0 of world 0 is nan: must be finite",
        "p-greedy": "BudgetExceededError: The budget of 50 decisions per world is used up",
        "p-writing": "MutatedObservationError: The observations of the last step were written into",
        "p-writinginuse": "MutatedObservationError",
    }
    names = ",".join([*bad, "p-learner", "p-scripted"])
    result = bench(
        "run", "--algo", names, "--protocol", "smoke", "--results", tmp_path / "results", "--workers", 1, "--json"
    )
    assert result.exit_code == 1
    printed = json.loads(result.stdout)
    states = {run["method"]: run["state"] for run in printed["runs"]}
    reasons = {run["method"]: run["reason"] for run in printed["runs"]} | printed["unavailable"]
    assert {name for name, state in states.items() if state == "done"} == {"p-learner", "p-scripted"}
    for name, reason in bad.items():
        assert reason in reasons[name]
        assert states.get(name, "failed") == "failed"
    failed = [json.loads(path.read_text()) for path in (tmp_path / "results" / "runs").glob("*/FAILED")]
    assert {content["method"] for content in failed} == set(bad) - {"p-raising"}


FAST = ("idm", "random", "random+guard", "cruise", "cruise+guard", "constant-speed", "constant-speed+guard", "sac")
SLOW = ("rss-guard", "safety-guard", "dd-rq", "dd-rq-plus", "cpo", "focops", "trpo-lag", "omnisafe")


@pytest.mark.parametrize(
    "name", [*FAST, *(pytest.param(name, marks=pytest.mark.slow) for name in (*SLOW, "omnisafe:algo=PPO"))]
)
def test_every_built_in_method_keeps_the_contract(name: str) -> None:
    report = contract.check_method(name)
    assert report.passed, [check for check in report.checks if not check.passed]


def test_the_suite_covers_every_built_in_method() -> None:
    built_in = {listing.name for listing in list_methods() if listing.origin.startswith("algorithms.")}
    assert built_in == {*FAST, *SLOW}

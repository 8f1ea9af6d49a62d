"""A repeated run has the bytes of its record, and what has not is named."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bench import rerun, store
from bench.cli.commands import app
from bench.errors import RecordError, UsageError
from bench.records import find_record, read_record
from bench.runner import run
from bench.spec import RunSpec

Make = Callable[..., RunSpec]


def test_a_repeated_run_is_identical_and_leaves_the_record_alone(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    record = run(make_spec(), tmp_path)
    before = {path: path.read_bytes() for path in record.path.rglob("*") if path.is_file()}
    found = find_record(tmp_path / "elsewhere", str(record.path))
    assert rerun.other_code(found) == []
    done = CliRunner().invoke(app, ["rerun", record.path.name, "--results", str(tmp_path), "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout) == {"identical": True, "differences": []}
    assert {path: path.read_bytes() for path in record.path.rglob("*") if path.is_file()} == before
    assert rerun.as_text(found, []).endswith("identical, 4 files.")


def test_what_differs_is_named_by_file_and_column(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    one = run(make_spec(), tmp_path / "1")
    two = run(make_spec(settings={"pace": "3"}), tmp_path / "2")
    other = run(make_spec(steps=1_000), tmp_path / "3")
    eval_line, policy_line = rerun.differences(one, two)
    assert eval_line.startswith("eval_episodes.parquet: 20 rows, other values of steps")
    assert policy_line == "policy/action.json: other bytes"
    assert any("scalars.parquet: 10 rows, then 5" in line for line in rerun.differences(one, other))
    assert not rerun.as_values([eval_line])["identical"]


def test_a_policy_that_is_not_published_is_compared_by_its_seal(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    one = run(make_spec(), tmp_path / "1")
    same, other = run(make_spec(), tmp_path / "2"), run(make_spec(settings={"pace": "3"}), tmp_path / "3")
    (one.path / "policy" / "action.json").unlink()
    assert list(rerun.differences(one, same)) == []
    assert "policy/action.json: other bytes" in list(rerun.differences(one, other))


def test_a_record_that_is_not_what_was_sealed_is_refused(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    one, same = run(make_spec(), tmp_path / "1"), run(make_spec(), tmp_path / "2")
    (one.path / "policy" / "action.json").write_text("{}")
    with pytest.raises(RecordError, match=r"action\.json is not what was sealed"):
        list(rerun.differences(one, same))


@pytest.mark.parametrize("name", [store.TRAIN_FILE, store.SCALARS_FILE])
def test_a_file_that_is_missing_is_refused_unless_it_is_the_policys(
    fakes: Path, tmp_path: Path, make_spec: Make, name: str
) -> None:
    one, same = run(make_spec(), tmp_path / "1"), run(make_spec(), tmp_path / "2")
    (one.path / name).unlink()
    with pytest.raises(RecordError, match=f"{name} cannot be read"):
        list(rerun.differences(one, same))


def test_a_missing_file_is_told_before_anything_is_repeated(
    fakes: Path, tmp_path: Path, make_spec: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = run(make_spec(), tmp_path)
    (record.path / store.TRAIN_FILE).unlink()
    monkeypatch.setattr(rerun, "_run", lambda *_: pytest.fail("it trains"))
    done = CliRunner().invoke(app, ["rerun", record.path.name, "--results", str(tmp_path)])
    assert done.exit_code == 1
    assert f"{store.TRAIN_FILE} cannot be read" in done.stderr


def test_a_results_folder_that_cannot_be_written_is_named(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    record = run(make_spec(), tmp_path)
    (tmp_path / "cache").write_text("in the way")
    done = CliRunner().invoke(app, ["rerun", record.path.name, "--results", str(tmp_path)])
    assert done.exit_code == 2
    assert f"bench: --results {tmp_path}: {tmp_path / 'cache'}" in done.stderr
    assert "make the folder writable, or give another one" in done.stderr


def test_other_sources_and_packages_are_named(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    record = run(make_spec(), tmp_path)
    made_by = record.details["provenance"]
    made_by.update(source_sha256="0", packages={**made_by["packages"], "numpy": "1.0"})
    made_by["git"].update(commit="f" * 40, dirty=False)
    code, numpy = rerun.other_code(record)
    assert f"commit {'f' * 40}; the sources here differ" in code
    assert numpy.startswith("numpy was 1.0, is 2.")


def test_a_run_of_another_version_is_refused(
    fakes: Path, tmp_path: Path, make_spec: Make, make_record: Callable[..., Path]
) -> None:
    record = read_record(make_record(tmp_path, method_version=2))
    with pytest.raises(UsageError, match="is of version 2 of fake-learner, this is version 1"):
        rerun.repeat(record, tmp_path, quiet=True)


def test_run_json_resolves_the_specification_and_locks_the_packages(
    fakes: Path, tmp_path: Path, make_spec: Make
) -> None:
    record = run(make_spec(scenario="a:vehicles=8", method="fake-learner:bias=2.0"), tmp_path)
    content = json.loads((record.path / store.RUN_FILE).read_text())
    resolved = content["resolved"]
    assert resolved["scenario"]["id"] == "a:vehicles=8-v1"
    assert (resolved["scenario"]["vehicles"], resolved["scenario"]["decision_period_s"]) == (8, 0.5)
    assert resolved["method"]["parameters"] == {"offset": 0.0, "bias": 2.0}
    assert len(set(resolved["seeds"]["streams"].values())) == 5
    packages = content["provenance"]["packages"]
    assert {"numpy", "torch", "stable-baselines3", "llvmlite", "filelock"} <= packages.keys()
    assert "pytest" not in packages, "what only tests need does not matter"

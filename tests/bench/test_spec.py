"""A specification's hash is the same wherever it is made, and another for every change that matters."""

import json
import re
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from bench.spec import RunSpec

Make = Callable[..., RunSpec]


def test_the_hash_of_a_known_specification_never_changes() -> None:
    spec = RunSpec(
        method="safety-guard:tc=1.0",
        method_version=1,
        scenario="a",
        scenario_version=1,
        seed=0,
        steps=4_000,
        eval_episodes=64,
    )
    assert spec.canonical_json == (
        '{"cost_limit":0.05,"cost_signal":"collision","eval_episodes":64,"method":"safety-guard:tc=1.0",'
        '"method_version":1,"scenario":"a","scenario_version":1,"seed":0,"settings":{},"spec_version":1,'
        '"steps":4000}'
    )
    assert spec.folder_name == "a-v1_safety-guard-tc=1.0_s0_c7d20fa6cf19"


@pytest.mark.parametrize(
    "change",
    [
        {"method": "sac"},
        {"method_version": 2},
        {"scenario": "b"},
        {"scenario_version": 2},
        {"seed": 1},
        {"steps": 2_005},
        {"eval_episodes": 21},
        {"cost_limit": 0.1},
        {"cost_signal": "ttc"},
        {"settings": {"pace": "2"}},
    ],
)
def test_each_field_changes_the_hash_and_the_folder(make_spec: Make, change: dict[str, Any]) -> None:
    assert make_spec(**change).hash != make_spec().hash
    assert make_spec(**change).folder_name != make_spec().folder_name


def test_every_field_is_in_the_sensitivity_test() -> None:
    assert len(RunSpec.model_fields) == 10


def test_the_order_of_settings_does_not_matter(make_spec: Make) -> None:
    assert make_spec(settings={"a": "1", "b": "2"}).hash == make_spec(settings={"b": "2", "a": "1"}).hash


def test_another_process_finds_the_same_hash(make_spec: Make) -> None:
    spec = make_spec(settings={"pace": "2"})
    code = f"from bench.spec import RunSpec; print(RunSpec.model_validate_json({spec.model_dump_json()!r}).hash)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == spec.hash


@given(method=st.text(max_size=200), scenario=st.text(max_size=200))
def test_a_folder_name_is_safe_on_every_file_system(method: str, scenario: str) -> None:
    spec = RunSpec(
        method=method,
        method_version=1,
        scenario=scenario,
        scenario_version=1,
        seed=0,
        steps=0,
        eval_episodes=1,
    )
    assert re.fullmatch(r"[A-Za-z0-9.=+_-]{1,140}", spec.folder_name)
    assert not spec.folder_name.startswith(".")


def test_an_unknown_field_is_refused_with_the_nearest_name(make_spec: Make) -> None:
    with pytest.raises(ValidationError, match="no field 'metod'; the nearest is 'method'"):
        make_spec(metod="sac")


@pytest.mark.parametrize(
    "bad",
    [
        {"seed": -1},
        {"steps": -5},
        {"eval_episodes": 0},
        {"cost_limit": float("nan")},
        {"cost_limit": -0.1},
        {"cost_signal": "colision"},
        {"seed": "0"},
    ],
)
def test_impossible_values_are_refused(make_spec: Make, bad: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        make_spec(**bad)


def test_a_specification_is_frozen(make_spec: Make) -> None:
    spec = make_spec(settings={"pace": "2"})
    with pytest.raises(ValidationError):
        spec.seed = 1
    with pytest.raises(TypeError):
        spec.settings["pace"] = "3"  # type: ignore[index]


def test_a_scenario_of_another_version_is_refused(make_spec: Make) -> None:
    with pytest.raises(ValueError, match="a-v1"):
        make_spec(scenario_version=7).resolve_scenario()


def test_seeds_share_a_variant_and_other_budgets_do_not(make_spec: Make) -> None:
    assert make_spec(seed=3).variant == make_spec().variant
    assert make_spec(steps=4_000).variant != make_spec().variant
    assert make_spec(settings={"pace": "2"}).variant != make_spec().variant
    assert json.loads(make_spec().canonical_json)["spec_version"] == 1

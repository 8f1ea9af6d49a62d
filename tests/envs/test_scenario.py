"""Scenarios are validated values, known by name, and refuse what no world can be built from."""

import dataclasses
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.scenario import (
    GYMNASIUM_IDS,
    PEDESTRIAN_SLOTS,
    PedestrianRule,
    Scenario,
    UnknownNameError,
    get_scenario,
    scenario_names,
)

BUILT_IN = {
    "a": Scenario("a"),
    "a-dense": Scenario("a-dense", vehicles=12),
    "a-mobil": Scenario("a-mobil", lane_changes=True),
    "a-dense-mobil": Scenario("a-dense-mobil", vehicles=12, lane_changes=True),
    "a-standing": Scenario("a-standing", standing_start=True),
    "b": Scenario("b", pedestrian_rule=PedestrianRule.FAIR),
    "b-late": Scenario("b-late", pedestrian_rule=PedestrianRule.LATE),
    "b-standing": Scenario("b-standing", pedestrian_rule=PedestrianRule.FAIR, standing_start=True),
}


def test_the_built_in_scenarios_are_these() -> None:
    assert {name: get_scenario(name) for name in scenario_names() if name in BUILT_IN} == BUILT_IN


def test_the_default_is_the_papers_scenario_a() -> None:
    a = get_scenario("a")
    assert (a.vehicles, a.lane_changes, a.pedestrians, a.standing_start) == (5, False, 0, False)
    assert (a.decision_period_s, a.substeps) == (0.5, 5)
    assert a.id == f"a-v{a.version}"


def test_scenario_b_has_as_many_pedestrians_as_the_state_has_slots() -> None:
    assert get_scenario("b").pedestrians == PEDESTRIAN_SLOTS == 3


def test_every_built_in_scenario_has_a_gymnasium_id_of_its_version() -> None:
    assert GYMNASIUM_IDS.keys() == BUILT_IN.keys()
    for name, gymnasium_id in GYMNASIUM_IDS.items():
        assert re.fullmatch(rf"bench/\w+-v{get_scenario(name).version}", gymnasium_id)
    assert len(set(GYMNASIUM_IDS.values())) == len(GYMNASIUM_IDS)


def test_a_scenario_is_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        get_scenario("a").vehicles = 6  # type: ignore[misc]


def test_parameters_ride_in_the_name_in_one_canonical_order() -> None:
    one = get_scenario("a:vehicles=8,decision_period_s=0.1,lane_changes=TRUE")
    other = get_scenario("a:lane_changes=true,decision_period_s=0.10,vehicles=8")
    assert one == other
    assert one.name == "a:decision_period_s=0.1,lane_changes=true,vehicles=8"
    assert (one.vehicles, one.substeps, one.lane_changes) == (8, 1, True)


def test_parameters_that_change_nothing_leave_the_scenario_itself() -> None:
    assert get_scenario("a:vehicles=5,lane_changes=false") is get_scenario("a")
    assert get_scenario("b:pedestrian_rule=late").name == "b:pedestrian_rule=late"


@given(
    vehicles=st.integers(1, 27),
    steps=st.integers(1, 100),
    lane_changes=st.booleans(),
    rule=st.sampled_from(PedestrianRule),
)
def test_the_name_of_a_scenario_gives_the_same_scenario_back(
    vehicles: int, steps: int, lane_changes: bool, rule: PedestrianRule
) -> None:
    tail = f"vehicles={vehicles},decision_period_s={steps / 10},lane_changes={lane_changes},pedestrian_rule={rule}"
    scenario = get_scenario(f"a:{tail}")
    assert get_scenario(scenario.name) == scenario
    assert scenario.substeps == steps
    assert scenario.pedestrians == (0 if rule is PedestrianRule.NONE else 3)


@pytest.mark.parametrize(("name", "meant"), [("a-dens", "a-dense"), ("a_mobil", "a-mobil"), ("b-lat", "b-late")])
def test_an_unknown_scenario_is_refused_with_the_nearest_known_name(name: str, meant: str) -> None:
    with pytest.raises(UnknownNameError, match=f"Unknown scenario '{name}'.*Did you mean.*{meant}") as caught:
        get_scenario(name)
    assert meant in caught.value.suggestions


def test_an_unknown_name_without_neighbours_still_lists_what_is_known() -> None:
    with pytest.raises(UnknownNameError, match=r"'zzzzzz'\. Known: a, a-dense,"):
        get_scenario("zzzzzz")


def test_an_unknown_parameter_is_refused_with_the_nearest_known_name() -> None:
    with pytest.raises(UnknownNameError, match=r"scenario parameter 'vehicle'.*Did you mean.*vehicles"):
        get_scenario("a:vehicle=8")


@pytest.mark.parametrize("parameter", ["name=x", "version=2"])
def test_name_and_version_are_no_parameters(parameter: str) -> None:
    with pytest.raises(UnknownNameError, match="Unknown scenario parameter"):
        get_scenario(f"a:{parameter}")


@pytest.mark.parametrize(
    ("parameter", "message"),
    [
        ("vehicles=-3", "vehicles = -3: must be 1 to 27, what fits"),
        ("vehicles=0", "vehicles = 0: must be 1 to 27, what fits"),
        ("vehicles=28", "vehicles = 28: must be 1 to 27, what fits"),
        ("vehicles=5.5", "vehicles = '5.5': expected int"),
        ("vehicles=many", "vehicles = 'many': expected int"),
        ("vehicles", "'vehicles': expected KEY=VALUE"),
        ("lane_changes=maybe", "lane_changes = 'maybe': expected bool"),
        ("pedestrian_rule=rude", "pedestrian_rule = 'rude': expected PedestrianRule"),
        ("decision_period_s=0.25", "decision_period_s = 0.25: must be a multiple of 0.1 s"),
        ("decision_period_s=0.05", "decision_period_s = 0.05: must be a multiple of 0.1 s"),
        ("decision_period_s=0", r"decision_period_s = 0.0: must be a multiple of 0.1 s"),
        ("decision_period_s=-0.5", "decision_period_s = -0.5: must be a multiple of 0.1 s"),
        ("decision_period_s=10.1", "decision_period_s = 10.1: must be a multiple of 0.1 s, at most 10 s"),
        ("decision_period_s=nan", "decision_period_s = nan: must be a multiple of 0.1 s"),
        ("decision_period_s=inf", "decision_period_s = inf: must be a multiple of 0.1 s"),
    ],
)
def test_a_bad_value_is_an_error_that_names_it(parameter: str, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message) if "'" in message else message):
        get_scenario(f"a:{parameter}")

"""Initial states: where the paper puts them, with room to move, and the same whenever episode k is asked for."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from algorithms.method import Budget, Task
from envs.layout import (
    CHUNK,
    EpisodeSource,
    held_out_source,
    sample_initial_worlds,
)
from envs.pedestrians import KERB_M
from envs.scenario import (
    FIRST_SPAWN_M,
    LANE_CAPACITY,
    SPACING_M,
    SPAWN_STRETCH_M,
    Scenario,
    get_scenario,
    scenario_names,
)  # fmt: skip
from envs.world import WAITING, World

LANE_CENTRES = (-3.5, 0.0, 3.5)


def sample(name: str, n: int = 2000, seed: int = 5) -> World:
    return sample_initial_worlds(get_scenario(name), np.random.SeedSequence(seed), n)


def same_bytes(one: World, other: World) -> bool:
    names = ("ego", "vehicles", "pedestrians", "episode")
    return all(getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in names)


def test_nine_cars_fit_into_a_lane_and_fill_it_exactly() -> None:
    # 20, 40, ..., 180 m.
    assert LANE_CAPACITY == 9
    vehicles = sample("a:vehicles=27", n=3).vehicles
    for lane in LANE_CENTRES:
        positions = [np.sort(row["s"][row["d"] == lane]) for row in vehicles]
        np.testing.assert_allclose(positions, [np.arange(20.0, 181.0, 20.0)] * 3)


def test_a_spawn_that_cannot_fit_is_an_error_that_names_the_number() -> None:
    with pytest.raises(ValueError, match=r"vehicles = 28: must be 1 to 27, what fits into 180 m of 3 lanes at 20 m"):
        Scenario("a", vehicles=28)


@settings(max_examples=40)
@given(st.integers(1, 27), st.integers(0, 2**32))
def test_cars_of_a_lane_are_spaced_within_the_spawn_stretch(vehicles: int, seed: int) -> None:
    cars = sample(f"a:vehicles={vehicles}", n=20, seed=seed).vehicles
    assert set(np.unique(cars["d"])) <= set(LANE_CENTRES)
    for row in cars:
        for lane in LANE_CENTRES:
            positions = np.sort(row["s"][row["d"] == lane])
            assert (np.diff(positions) >= SPACING_M - 1e-9).all()
            assert (positions >= FIRST_SPAWN_M).all()
            assert (positions <= SPAWN_STRETCH_M).all()


def test_the_only_car_of_a_lane_may_be_anywhere_in_the_stretch() -> None:
    s = sample("a:vehicles=1").vehicles["s"]
    assert (s.min(), s.max()) == pytest.approx((FIRST_SPAWN_M, SPAWN_STRETCH_M), abs=1.0)
    assert s.mean() == pytest.approx(100.0, abs=3.5)  # 160 / sqrt(12 x 2000) = 1.03 m


def test_the_last_of_several_cars_reaches_the_end_of_the_stretch() -> None:
    assert sample("a-dense", n=20_000).vehicles["s"].max() == pytest.approx(SPAWN_STRETCH_M, abs=0.5)


@pytest.mark.parametrize("name", ["a", "a-dense"])
def test_lanes_of_ego_and_traffic_are_equally_likely(name: str) -> None:
    world = sample(name, n=6000)
    for d in (world.ego["d"], world.vehicles["d"]):
        shares = [(d == lane).mean() for lane in LANE_CENTRES]
        assert shares == pytest.approx([1 / 3] * 3, abs=0.025)  # 4 standard errors of 6000 draws


def test_speeds_start_where_the_paper_says() -> None:
    world = sample("a")
    for speed in (world.ego["speed"], world.vehicles["speed"]):
        assert (speed.min(), speed.max()) == pytest.approx((8.0, 12.0), abs=0.02)
        assert speed.mean() == pytest.approx(10.0, abs=0.11)
    assert (world.vehicles["speed"] == world.vehicles["desired_speed"]).all()
    assert np.unique(world.vehicles["headway"]).tolist() == [1.5]
    assert np.unique(world.vehicles["exponent"]).tolist() == [4.0]


def test_the_ego_starts_at_the_origin_on_its_plan_without_a_command() -> None:
    ego = sample("a").ego
    assert (ego["reference_d"] == ego["d"]).all()
    assert (ego["target_d"] == ego["d"]).all()
    others = ("s", "heading", "lateral_speed", "acceleration", "reference_speed", "command", "error_integral")
    assert all((ego[name] == 0.0).all() for name in others)


@pytest.mark.parametrize("name", ["a-standing", "b-standing"])
def test_a_standing_start_changes_the_egos_speed_and_nothing_else(name: str) -> None:
    standing, moving = sample(name), sample(name.removesuffix("-standing"))
    assert (standing.ego["speed"] == 0.0).all()
    standing.ego["speed"] = moving.ego["speed"]
    assert same_bytes(standing, moving)


def test_traffic_keeps_its_lane_and_its_timer_starts_from_the_position() -> None:
    cars = sample("a-dense-mobil", n=200).vehicles
    assert (cars["d"] == (cars["target_lane"] - 1) * 3.5).all()
    # highway-env's IDMVehicle: (x + y) pi modulo the delay of 1 s.
    expected = np.fmod((cars["s"] + cars["d"]) * math.pi, 1.0)
    np.testing.assert_allclose(cars["timer"], expected, atol=1e-9)


def test_pedestrians_wait_at_either_kerb_and_face_the_road() -> None:
    people = sample("b").pedestrians
    assert (people["state"] == WAITING).all()
    assert (np.abs(people["d"]) == KERB_M).all()
    assert (np.sign(people["lateral_speed"]) == -np.sign(people["d"])).all()
    assert (people["d"] > 0.0).mean() == pytest.approx(0.5, abs=0.03)
    ranges = {"s": (80.0, 740.0, 1.0), "trigger_gap": (30.0, 90.0, 0.1)}
    for name, (low, high, tolerance) in ranges.items():
        assert (people[name].min(), people[name].max()) == pytest.approx((low, high), abs=tolerance)
    speed = np.abs(people["lateral_speed"])
    assert (speed.min(), speed.max()) == pytest.approx((0.8, 1.8), abs=0.01)


def test_randomised_traffic_varies_number_speeds_and_idm_parameters() -> None:
    cars = sample("a:randomised_traffic=true").vehicles
    present = cars["present"].sum(axis=1)
    assert (present.min(), present.max()) == (1, 5)
    assert (np.diff(cars["present"], axis=1) <= 0).all()
    assert (cars["desired_speed"].min(), cars["desired_speed"].max()) == pytest.approx((5.0, 13.89), abs=0.1)
    spread = np.ptp(cars["desired_speed"], axis=1)
    assert spread.max() <= 6.0
    assert (np.ptp(cars["headway"], axis=1) == 0.0).all()
    assert (cars["headway"].min(), cars["headway"].max()) == pytest.approx((1.0, 2.0), abs=0.01)
    assert (cars["exponent"].min(), cars["exponent"].max()) == pytest.approx((3.5, 4.5), abs=0.01)
    assert (cars["speed"] == cars["desired_speed"]).all()


def test_ego_traffic_and_pedestrians_draw_from_streams_of_their_own() -> None:
    a, b, dense, late = (sample(name, n=50) for name in ("a", "b", "a-dense", "b-late"))
    assert a.ego.tobytes() == b.ego.tobytes() == dense.ego.tobytes()
    assert a.vehicles.tobytes() == b.vehicles.tobytes()
    assert b.pedestrians.tobytes() == late.pedestrians.tobytes()


@pytest.mark.parametrize("name", ["a", "b"])
def test_a_chunk_is_the_same_whoever_asks_and_whenever(name: str) -> None:
    scenario = get_scenario(name)
    one = EpisodeSource(scenario, np.random.SeedSequence(3))
    other = EpisodeSource(scenario, np.random.SeedSequence(3), start=2000, stop=4000)
    second = one.chunk(1)
    one.chunk(0)
    assert same_bytes(second, other.chunk(1))
    assert same_bytes(second, one.chunk(1))
    assert second.episode["episode"].tolist() == list(range(CHUNK, 2 * CHUNK))


def fingerprints(source: EpisodeSource, chunks: int) -> set[float]:
    """Start speeds of the ego: 53 random bits each, so two equal ones mean one and the same draw."""
    return {float(v) for index in range(chunks) for v in source.chunk(index).ego["speed"]}


def test_no_episode_of_a_stream_repeats() -> None:
    assert len(fingerprints(held_out_source(get_scenario("a"), 5000), 5)) == 5 * CHUNK


@pytest.mark.parametrize("name", ["a", "b"])
def test_training_and_held_out_episodes_are_disjoint(name: str) -> None:
    scenario = get_scenario(name)
    held_out = fingerprints(held_out_source(scenario, 10_000), 10)
    for seed in range(5):
        stream = Task(scenario, seed, Budget(1000)).stream("train")
        assert held_out.isdisjoint(fingerprints(EpisodeSource(scenario, stream), 4))
    for seed in range(20):
        assert held_out.isdisjoint(fingerprints(EpisodeSource(scenario, np.random.SeedSequence(seed)), 1))


def test_training_streams_of_different_seeds_are_disjoint() -> None:
    scenario = get_scenario("a")
    tasks = [Task(scenario, seed, Budget(1000)) for seed in range(5)]
    drawn = [fingerprints(EpisodeSource(scenario, task.stream("train")), 2) for task in tasks]
    assert len(set.union(*drawn)) == 5 * 2 * CHUNK


def test_the_held_out_list_is_frozen_and_belongs_to_one_scenario_and_version() -> None:
    a = get_scenario("a")
    assert same_bytes(held_out_source(a, 10).chunk(0), held_out_source(a, 9999).chunk(0))
    others = [get_scenario(name) for name in scenario_names() if name != "a"]
    others += [get_scenario("a:decision_period_s=0.1"), Scenario("a", version=2)]
    first = held_out_source(a, 10).chunk(0).ego["speed"][0]
    assert all(held_out_source(s, 10).chunk(0).ego["speed"][0] != first for s in others)


def test_the_first_held_out_episode_of_version_1_is_this_one() -> None:
    # Results of version 1 rest on it: other values mean another version.
    start = held_out_source(get_scenario("b"), 1).chunk(0)
    assert start.ego["speed"][0] == pytest.approx(11.217950051865078, abs=1e-9)
    cars = [63.10834915, 87.85135605, 128.63407752, 154.91825266, 175.96047037]
    np.testing.assert_allclose(start.vehicles["s"][0], cars, atol=1e-6)
    np.testing.assert_allclose(start.pedestrians["s"][0], [557.97124725, 627.55735555, 161.52965523], atol=1e-6)

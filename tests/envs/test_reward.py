"""Reward terms and exposure by hand, from the paper's appendix and its reward tables."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.reward import comfort_reward, lane_deviation_reward, path_exposure, speed_reward
from envs.world import CROSSING, WAITING
from tests.envs.small_worlds import Fields, one_world

pytestmark = pytest.mark.kernels


@pytest.mark.parametrize(
    ("speed", "reward"),
    [
        (0.0, 0.0),
        (4.0, 0.25),  # half of the starting phase: 0.5 x 0.5
        (8.0, 0.5),
        (10.945, 2.5),  # half of the maintaining phase: 0.5 + 4 x 0.5
        (13.89, 4.5),
        (20.0, 4.5),
        (-1.0, 0.0),
    ],
)
def test_speed_reward_by_hand(speed: float, reward: float) -> None:
    assert speed_reward(speed) == pytest.approx(reward)


@given(st.floats(0.0, 15.0), st.floats(0.0, 15.0))
def test_speed_reward_grows_with_speed_within_0_and_4_5(one: float, other: float) -> None:
    low, high = sorted((one, other))
    assert 0.0 <= speed_reward(low) <= speed_reward(high) <= 4.5


@pytest.mark.parametrize(
    ("d", "reward"),
    [(0.0, 0.0), (0.5, -0.5), (-0.5, -0.5), (1.75, -1.75), (3.0, -0.5), (3.5, 0.0), (-4.25, -0.75), (5.25, -1.75)],
)
def test_lane_deviation_costs_1_per_metre_to_the_nearest_centre(d: float, reward: float) -> None:
    assert lane_deviation_reward(d) == pytest.approx(reward)


@given(st.floats(-5.25, 5.25))
def test_lane_deviation_is_the_same_on_both_sides_and_at_most_half_a_lane(d: float) -> None:
    assert lane_deviation_reward(d) == pytest.approx(lane_deviation_reward(-d), abs=1e-12)
    assert -1.75 - 1e-12 <= lane_deviation_reward(d) <= 0.0


@pytest.mark.parametrize(
    ("arguments", "reward"),
    [
        ((0.0, 0.0, 0.0, 0.0), 0.0),
        # A lane to the left: -0.5 x 3.5 / (2 x 3.5).
        ((3.5, 0.0, 1.0, 1.0), -0.25),
        ((-1.75, 1.75, 0.5, 0.5), -0.25),
        # From full braking to full throttle: -0.5 x 4 / 4.
        ((1.0, 1.0, 2.0, -2.0), -0.5),
        ((0.0, 3.5, -1.0, 1.0), -0.25 - 0.25),
    ],
)
def test_comfort_reward_by_hand(arguments: tuple[float, float, float, float], reward: float) -> None:
    assert comfort_reward(*arguments) == pytest.approx(reward)


TARGETS, COMMANDS = st.floats(-4.25, 4.25), st.floats(-2.0, 2.0)


@given(TARGETS, TARGETS, COMMANDS, COMMANDS)
def test_comfort_reward_is_never_positive_and_forgets_the_order(a: float, b: float, x: float, y: float) -> None:
    assert comfort_reward(a, b, x, y) == comfort_reward(b, a, y, x) <= 0.0
    assert comfort_reward(a, a, x, x) == 0.0


def exposure(ego: Fields, vehicles: list[Fields], people: list[Fields] | None = None) -> tuple[float, float]:
    """Everybody 1.5 m further to the left than named, which must not matter."""
    moved = [[{**body, "d": body.get("d", 0.0) + 1.5} for body in bodies] for bodies in ([ego], vehicles, people or [])]
    world = one_world(moved[0][0], moved[1], moved[2])
    gap, ttc = path_exposure(world.ego, world.vehicles, world.pedestrians, 0)
    return float(gap), float(ttc)


EGO = {"s": 100.0, "d": 0.0, "speed": 10.0}


def test_an_empty_path_exposes_to_nothing() -> None:
    assert exposure(EGO, []) == (math.inf, math.inf)


@pytest.mark.parametrize(
    ("car", "gap", "ttc"),
    [
        ({"s": 130.0, "speed": 6.0}, 25.0, 25.0 / 4.0),
        ({"s": 130.0, "speed": 10.0}, 25.0, math.inf),
        ({"s": 130.0, "speed": 12.0}, 25.0, math.inf),
        ({"s": 130.0, "speed": 10.0, "heading": 0.5}, 25.0, 25.0 / (10.0 - 10.0 * math.cos(0.5))),
        ({"s": 104.0, "speed": 6.0}, 0.0, 0.0),  # beyond contact the gap is 0, not negative
        ({"s": 130.0, "d": 1.9999, "speed": 6.0}, 25.0, 6.25),
        ({"s": 130.0, "d": -2.0, "speed": 6.0}, math.inf, math.inf),  # beside the ego's width
        ({"s": 70.0, "speed": 20.0}, math.inf, math.inf),  # behind
        ({"s": 130.0, "speed": 6.0, "present": 0}, math.inf, math.inf),
    ],
)
def test_exposure_to_one_car_by_hand(car: Fields, gap: float, ttc: float) -> None:
    assert exposure(EGO, [car]) == pytest.approx((gap, ttc))


def test_the_egos_speed_counts_along_the_road() -> None:
    gap, ttc = exposure({**EGO, "heading": 0.3}, [{"s": 130.0, "speed": 6.0}])
    assert (gap, ttc) == pytest.approx((25.0, 25.0 / (10.0 * math.cos(0.3) - 6.0)))


@pytest.mark.parametrize(
    ("person", "gap", "ttc"),
    [
        ({"state": CROSSING, "s": 120.0}, 17.2, 1.72),
        ({"state": WAITING, "s": 120.0}, math.inf, math.inf),
        ({"state": CROSSING, "s": 120.0, "d": 1.2999}, 17.2, 1.72),
        ({"state": CROSSING, "s": 120.0, "d": -1.3}, math.inf, math.inf),
        ({"state": CROSSING, "s": 80.0}, math.inf, math.inf),
        ({"state": CROSSING, "s": 102.0}, 0.0, 0.0),
    ],
)
def test_exposure_to_one_pedestrian_by_hand(person: Fields, gap: float, ttc: float) -> None:
    assert exposure(EGO, [], [person]) == pytest.approx((gap, ttc))


def test_a_standing_ego_has_a_gap_to_a_pedestrian_but_no_time_to_collision() -> None:
    assert exposure({**EGO, "speed": 0.0}, [], [{"state": CROSSING, "s": 120.0}]) == pytest.approx((17.2, math.inf))


def test_gap_and_time_to_collision_are_each_the_least_over_all_bodies() -> None:
    near_and_fast, far_and_slow = {"s": 115.0, "speed": 9.9}, {"s": 140.0, "speed": 1.0}
    assert exposure(EGO, [far_and_slow, near_and_fast]) == pytest.approx((10.0, 35.0 / 9.0))
    person = {"state": CROSSING, "s": 112.8}
    assert exposure(EGO, [near_and_fast], [person]) == pytest.approx((10.0, 1.0))

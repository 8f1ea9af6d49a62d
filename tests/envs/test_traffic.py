"""IDM, MOBIL and the traffic's steering against hand values; whole episodes are held against highway-env elsewhere."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.motion import STEERING_MAX_RAD
from envs.traffic import (
    NOBODY,
    decide,
    decide_lane,
    following_acceleration,
    idm_acceleration,
    judged_acceleration,
    lane_steering,
    move,
    neighbour,
    not_zero,
)
from envs.world import CROSSING, GONE, WAITING, World
from tests.envs.small_worlds import one_world

kernels = pytest.mark.kernels
SPEEDS = st.floats(0.0, 14.0)
BRAKING_ROOT = math.sqrt(3.0 * 5.0)
FAR_BEHIND = {"s": -500.0, "speed": 10.0}
"""The ego, out of everybody's way."""


@kernels
@pytest.mark.parametrize(
    ("x", "expected"), [(2.0, 2.0), (-2.0, -2.0), (0.0, 0.01), (0.01, 0.01), (-0.001, -0.01), (0.002, 0.01)]
)
def test_not_zero_keeps_a_hundredth_from_zero_and_the_sign(x: float, expected: float) -> None:
    assert not_zero(x) == expected


@kernels
@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        # Free road at half the desired speed: 3 (1 - 0.5^4), with exponent 2: 3 (1 - 0.5^2).
        ((6.0, 12.0, 4.0, 1.5, math.inf, 0.0), 2.8125),
        ((6.0, 12.0, 2.0, 1.5, math.inf, 0.0), 2.25),
        ((12.0, 12.0, 4.0, 1.5, math.inf, 0.0), 0.0),
        ((14.0, 10.0, 4.0, 1.5, math.inf, 0.0), 3.0 * (1.0 - 1.4**4)),
        # At the desired speed the free part is 0. Desired gap 10 + 15 + 10 x 2 / (2 sqrt 15) = 27.58199 m,
        # so -3 (27.58199 / 40)^2.
        ((10.0, 10.0, 4.0, 1.5, 40.0, 2.0), -1.426437),
        # An opening gap wants less: 25 - 2.58199 = 22.41801 m.
        ((10.0, 10.0, 4.0, 1.5, 40.0, -2.0), -0.942314),
        # Headway 1 s: 10 + 10 = 20 m at equal speeds, -3 (20 / 40)^2.
        ((10.0, 10.0, 4.0, 1.0, 40.0, 0.0), -0.75),
        # At rest 12 m behind a standing car: 3 - 3 (10 / 12)^2.
        ((0.0, 10.0, 4.0, 1.5, 12.0, 0.0), 3.0 - 3.0 * 100.0 / 144.0),
        # A gap of 0 counts as 0.01 m, a desired speed of 0 as 0.01 m/s.
        ((0.0, 10.0, 4.0, 1.5, 0.0, 0.0), 3.0 - 3.0e6),
        ((0.02, 0.0, 4.0, 1.5, math.inf, 0.0), 3.0 * (1.0 - 16.0)),
    ],
)
def test_idm_by_hand(arguments: tuple[float, ...], expected: float) -> None:
    assert idm_acceleration(*arguments) == pytest.approx(expected, rel=1e-6)


@kernels
@given(SPEEDS, st.floats(5.0, 14.0), st.floats(6.0, 200.0), st.floats(-5.0, 10.0), st.floats(0.1, 50.0))
def test_idm_asks_for_less_when_the_leader_is_nearer_or_slower(
    speed: float, desired: float, gap: float, closing: float, more: float
) -> None:
    a = idm_acceleration(speed, desired, 4.0, 1.5, gap, closing)
    wanted = 10.0 + 1.5 * speed + speed * closing / (2.0 * BRAKING_ROOT)
    if wanted > 0.0:  # highway-env squares the desired gap even where it is negative
        assert idm_acceleration(speed, desired, 4.0, 1.5, gap + more, closing) >= a
        assert idm_acceleration(speed, desired, 4.0, 1.5, gap, closing + more) <= a
    assert idm_acceleration(speed, desired, 4.0, 1.5, math.inf, 0.0) >= a
    assert idm_acceleration(speed, desired + more, 4.0, 1.5, gap, closing) >= a


def people(state: int, s: float, d: float = 0.0) -> dict[str, float]:
    return {"state": state, "s": s, "d": d, "lateral_speed": 1.0}


@kernels
def test_neighbours_are_the_nearest_present_bodies_of_the_lane() -> None:
    world = one_world(
        {"s": 0.0},
        [
            {"s": 50.0, "d": 0.0},
            {"s": 30.0, "d": 3.5},  # another lane
            {"s": 20.0, "d": 0.0, "present": 0},
            {"s": 60.0, "d": 2.7},  # within 1 m of the lane's edge: counts for both lanes
            {"s": -9.0, "d": 0.0},
        ],
        [people(WAITING, 10.0), people(CROSSING, 40.0, -2.74), people(GONE, 5.0)],
    )
    w = (world.ego, world.vehicles, world.pedestrians)
    ego, vehicle = 0, 1
    crossing = 1 + 5 + 1
    assert [neighbour(*w, 0, ego, 1, ahead) for ahead in (True, False)] == [crossing, 5]
    assert [neighbour(*w, 0, ego, 2, ahead) for ahead in (True, False)] == [2, NOBODY]
    assert [neighbour(*w, 0, vehicle, 1, ahead) for ahead in (True, False)] == [4, crossing]
    assert [neighbour(*w, 0, 5, 1, ahead) for ahead in (True, False)] == [ego, NOBODY]
    assert [neighbour(*w, 0, vehicle, 2, ahead) for ahead in (True, False)] == [4, 2]


@kernels
@pytest.mark.parametrize(("d", "seen"), [(2.75, True), (2.7500001, False), (-2.75, True), (-2.7500001, False)])
def test_a_body_counts_on_a_lane_up_to_a_metre_beyond_its_edge(d: float, seen: bool) -> None:
    world = one_world({"s": 0.0}, [{"s": 30.0, "d": d}])
    ahead = neighbour(world.ego, world.vehicles, world.pedestrians, 0, 0, 1, True)
    assert (ahead == 1) is seen


@kernels
def test_a_body_at_the_same_position_is_ahead() -> None:
    world = one_world({"s": 5.0}, [{"s": 5.0}])
    w = (world.ego, world.vehicles, world.pedestrians)
    assert [neighbour(*w, 0, 0, 1, ahead) for ahead in (True, False)] == [1, NOBODY]
    assert [neighbour(*w, 0, 1, 1, ahead) for ahead in (True, False)] == [0, NOBODY]


def follow(world: World, k: int, leader: int) -> float:
    return float(following_acceleration(world.ego, world.vehicles, world.pedestrians, 0, k, leader))


@kernels
def test_followers_take_gap_and_closing_speed_from_their_leader() -> None:
    world = one_world({"s": 0.0, "speed": 13.89}, [{"s": 40.0, "speed": 8.0}, {"s": 80.0, "speed": 6.0}])
    assert follow(world, 1, 2) == pytest.approx(idm_acceleration(8.0, 8.0, 4.0, 1.5, 40.0, 2.0))
    # MOBIL sees the ego as a driver who wants v_max.
    assert follow(world, 0, 1) == pytest.approx(idm_acceleration(13.89, 13.89, 4.0, 1.5, 40.0, 5.89))
    assert follow(world, 2, NOBODY) == pytest.approx(0.0)
    assert follow(world, NOBODY, 1) == 0.0


@kernels
def test_a_crossing_pedestrian_stands_still_along_the_road() -> None:
    world = one_world(FAR_BEHIND, [{"s": 0.0, "speed": 10.0}], [people(CROSSING, 40.0)])
    assert follow(world, 1, 2) == pytest.approx(idm_acceleration(10.0, 10.0, 4.0, 1.5, 40.0, 10.0))
    assert follow(world, 2, NOBODY) == 0.0


@kernels
def test_a_leader_who_turns_away_counts_with_its_speed_along_the_own_heading() -> None:
    follower, leader = {"s": 0.0, "speed": 10.0, "heading": 0.1}, {"s": 40.0, "speed": 8.0, "heading": 0.4}
    world = one_world(FAR_BEHIND, [follower, leader])
    closing = 10.0 - 8.0 * math.cos(0.3)
    assert follow(world, 1, 2) == pytest.approx(idm_acceleration(10.0, 10.0, 4.0, 1.5, 40.0, closing))


@kernels
def test_a_judged_follower_keeps_its_desired_speed_and_takes_the_judges_headway_and_exponent() -> None:
    judge = {"s": 40.0, "speed": 8.0, "headway": 1.0, "exponent": 2.0}
    world = one_world(FAR_BEHIND, [{"s": 0.0, "speed": 10.0, "desired_speed": 12.0}, judge])
    imposed = judged_acceleration(world.ego, world.vehicles, world.pedestrians, 0, 2, 1, 2)
    assert imposed == pytest.approx(idm_acceleration(10.0, 12.0, 2.0, 1.0, 40.0, 2.0))
    assert follow(world, 1, 2) == pytest.approx(idm_acceleration(10.0, 12.0, 4.0, 1.5, 40.0, 2.0))


def chosen_lane(vehicles: list[dict[str, Any]], j: int = 0, ego: dict[str, float] | None = None) -> int:
    """Target lane of vehicle j once its timer has run out."""
    vehicles[j].setdefault("timer", 1.05)
    world = one_world(ego or FAR_BEHIND, vehicles)
    decide_lane(world.ego, world.vehicles, world.pedestrians, 0, j)
    return int(world.vehicles.target_lane[0, j])


def slow_leader(d: float = 0.0, **fields: float) -> list[dict[str, Any]]:
    """A car at 10 m/s, 30 m behind one at 6 m/s."""
    return [{"s": 0.0, "d": d, "speed": 10.0, **fields}, {"s": 30.0, "d": d, "speed": 6.0}]


@kernels
def test_mobil_leaves_a_slow_leader_for_a_free_lane_on_either_side() -> None:
    assert chosen_lane(slow_leader(d=-3.5)) == 1
    assert chosen_lane(slow_leader(d=3.5)) == 1
    assert chosen_lane(slow_leader()) == 2  # both would do; the later candidate stays
    assert chosen_lane([*slow_leader(), {"s": 30.0, "d": 3.5, "speed": 6.0}]) == 0


@kernels
def test_mobil_stays_on_a_free_lane() -> None:
    assert chosen_lane([{"s": 0.0, "speed": 10.0}]) == 1


@kernels
@pytest.mark.parametrize(("gap", "lane"), [(53.0, 2), (54.0, 1)])
def test_mobil_changes_for_a_gain_of_at_least_a_fifth(gap: float, lane: int) -> None:
    # Everybody at 8 m/s, as desired: a desired gap of 22 m, so a leader costs 3 (22 / gap)^2. The own one 0.5169 at
    # 53 m and 0.4979 at 54 m, the left one 0.3006 at 69.5 m: gains of 0.2163 and 0.1973. The right one gains nothing.
    gain = 3.0 * (22.0 / gap) ** 2 - 3.0 * (22.0 / 69.5) ** 2
    assert (gain >= 0.2) is (lane == 2)
    cars = [{"s": 0.0, "speed": 8.0}, {"s": gap, "speed": 8.0}]
    sides = [{"s": 69.5, "d": 3.5, "speed": 8.0}, {"s": 53.5, "d": -3.5, "speed": 8.0}]
    assert chosen_lane([*cars, *sides]) == lane


@kernels
@pytest.mark.parametrize(("behind", "lane"), [(31.0, 1), (33.0, 2)])
def test_mobil_imposes_no_more_than_2_mps2_on_the_new_follower(behind: float, lane: int) -> None:
    # The follower at 12 m/s, 2 m/s faster, wants 13: the free road gives it 3 (1 - (12 / 13)^4) = 0.822 m/s2. Desired
    # gap 10 + 18 + 24 / (2 sqrt 15) = 31.098 m, so it brakes at 2 m/s2 where 3 (31.098 / gap)^2 = 2.822: at 32.06 m.
    follower = {"s": -behind, "d": 3.5, "speed": 12.0, "desired_speed": 13.0}
    blocked = {"s": 30.0, "d": -3.5, "speed": 6.0}
    assert chosen_lane([*slow_leader(), blocked, follower]) == lane


@kernels
def test_mobil_counts_the_ego_as_a_follower_who_wants_50_kmh() -> None:
    blocked = {"s": 30.0, "d": -3.5, "speed": 6.0}
    near, far = ({"s": s, "d": 3.5, "speed": 10.0} for s in (-15.0, -40.0))
    assert chosen_lane([*slow_leader(), blocked], ego=near) == 1
    assert chosen_lane([*slow_leader(), blocked], ego=far) == 2


@kernels
@pytest.mark.parametrize(("fields", "lane"), [({"timer": 1.0}, 1), ({"timer": 1.05}, 2), ({"speed": 0.9}, 1)])
def test_mobil_decides_once_a_second_and_only_on_the_move(fields: dict[str, float], lane: int) -> None:
    assert chosen_lane(slow_leader(**fields)) == lane


@kernels
def test_a_decision_starts_the_timer_again_whatever_it_is() -> None:
    world = one_world(FAR_BEHIND, [{"s": 0.0, "speed": 10.0, "timer": 1.05}])
    decide_lane(world.ego, world.vehicles, world.pedestrians, 0, 0)
    assert world.vehicles.timer[0, 0] == 0.0


@kernels
@pytest.mark.parametrize(
    ("other", "lane"),
    [
        ({"s": 20.0, "d": 3.5}, 0),  # also on its way into the middle, within the desired gap: give way
        ({"s": 20.0, "d": 3.5, "target_lane": 2}, 1),  # keeps its lane
        ({"s": -20.0, "d": 3.5}, 1),  # behind
        ({"s": 60.0, "d": 3.5}, 1),  # beyond the desired gap of 10 + 15 m
        ({"s": 20.0, "d": 0.0}, 1),  # in the middle already
        ({"s": 20.0, "d": 3.5, "present": 0}, 1),
        # 26 m ahead, 2 m/s slower: the desired gap grows by 20 / (2 sqrt 15) = 2.58 m to 27.58 m.
        ({"s": 26.0, "d": 3.5, "speed": 8.0}, 0),
        ({"s": 26.0, "d": 3.5, "speed": 10.0}, 1),
    ],
)
def test_a_lane_change_is_given_up_for_a_car_ahead_that_changes_into_the_same_lane(
    other: dict[str, float], lane: int
) -> None:
    changing = {"s": 0.0, "d": -3.5, "speed": 10.0, "target_lane": 1}
    assert chosen_lane([changing, {"target_lane": 1, "speed": 10.0, **other}]) == lane


@kernels
def test_who_gives_way_reckons_with_the_others_speed_along_the_own_heading() -> None:
    # Parallel at 0.5 rad, 8 against 10 m/s: the desired gap is 27.58 m, as above, and 30 m are enough.
    changing = {"s": 0.0, "d": -3.5, "speed": 10.0, "heading": 0.5, "target_lane": 1}
    other = {"s": 30.0, "d": 3.5, "speed": 8.0, "heading": 0.5, "target_lane": 1}
    assert chosen_lane([changing, other]) == 1
    assert chosen_lane([changing, {**other, "s": 27.0}]) == 0


@kernels
@pytest.mark.parametrize(
    ("d", "heading", "speed", "lane"),
    [(0.3, 0.02, 10.0, 1), (3.0, -0.05, 8.0, 2), (-3.4, 0.0, 5.0, 0), (0.1, 3.1, 10.0, 1), (0.1, -3.1, 10.0, 1)],
)
def test_lane_steering_by_hand(d: float, heading: float, speed: float, lane: int) -> None:
    # Lateral speed -(d - centre) / 0.6 s, as a heading; the turn towards it within 0.2 s, as a slip angle.
    reference = math.asin(-(d - (lane - 1) * 3.5) / 0.6 / speed)
    turn = math.remainder(reference - heading, 2.0 * math.pi)
    slip = math.asin(min(max(2.5 / speed * 5.0 * turn, -1.0), 1.0))
    expected = math.atan(2.0 * math.tan(slip))
    expected = min(max(expected, -STEERING_MAX_RAD), STEERING_MAX_RAD)
    assert lane_steering(d, heading, speed, lane) == pytest.approx(expected)


@kernels
@given(st.floats(-6.0, 6.0), st.floats(-0.7, 0.7), SPEEDS, st.integers(0, 2))
def test_lane_steering_is_bounded_and_the_same_in_a_mirror(d: float, heading: float, speed: float, lane: int) -> None:
    steering = lane_steering(d, heading, speed, lane)
    assert abs(steering) <= STEERING_MAX_RAD
    assert lane_steering(-d, -heading, speed, 2 - lane) == pytest.approx(-steering, abs=1e-12)


def decided(world: World, lane_changes: bool = False) -> np.ndarray:
    decide(world.ego, world.vehicles, world.pedestrians, 0, lane_changes)
    accelerations: np.ndarray = world.vehicles.acceleration[0]
    return accelerations


@kernels
def test_every_present_vehicle_follows_the_body_ahead_in_its_lane() -> None:
    cars = [{"s": 0.0, "speed": 10.0}, {"s": 40.0, "speed": 8.0}, {"s": 20.0, "d": 3.5, "speed": 9.0}]
    world = one_world(FAR_BEHIND, [*cars, {"s": 20.0, "present": 0}])
    expected = [idm_acceleration(10.0, 10.0, 4.0, 1.5, 40.0, 2.0), 0.0, 0.0, 0.0]
    assert decided(world) == pytest.approx(expected)


@kernels
def test_traffic_yields_to_the_ego_ahead_and_to_crossing_pedestrians() -> None:
    world = one_world({"s": 20.0, "speed": 8.0}, [{"s": -20.0, "speed": 10.0}])
    assert decided(world) == pytest.approx([idm_acceleration(10.0, 10.0, 4.0, 1.5, 40.0, 2.0)])
    world = one_world(FAR_BEHIND, [{"s": 0.0, "speed": 10.0}], [people(CROSSING, 60.0)])
    assert decided(world) == pytest.approx([idm_acceleration(10.0, 10.0, 4.0, 1.5, 60.0, 10.0)])


@kernels
def test_traffic_accelerates_and_brakes_at_6_mps2_at_most() -> None:
    world = one_world(FAR_BEHIND, [{"s": 0.0, "speed": 10.0}, {"s": 8.0, "speed": 0.0}])
    assert decided(world)[0] == -6.0


@kernels
def test_a_vehicle_in_a_lane_change_minds_the_leaders_of_both_lanes() -> None:
    changing = {"s": 0.0, "d": 0.2, "speed": 10.0, "target_lane": 2, "timer": 0.0}
    for lateral, leader in ((0.0, 40.0), (3.5, 40.0)):
        other = 3.5 - lateral
        world = one_world(
            FAR_BEHIND, [changing, {"s": leader, "d": lateral, "speed": 8.0}, {"s": 90.0, "d": other, "speed": 8.0}]
        )
        assert decided(world, True)[0] == pytest.approx(idm_acceleration(10.0, 10.0, 4.0, 1.5, 40.0, 2.0))
        assert world.vehicles.steering[0, 0] == pytest.approx(lane_steering(0.2, 0.0, 10.0, 2))


@kernels
def test_vehicles_decide_one_after_another_on_shared_state() -> None:
    # Both would leave their slow leaders for the free middle lane. The rear one decides later, sees that the one
    # ahead is on its way there, and must give its change up at its next decision.
    left = [{"s": 5.0, "d": 3.5, "speed": 10.0, "timer": 1.05}, {"s": 35.0, "d": 3.5, "speed": 6.0}]
    right = [{"s": 0.0, "d": -3.5, "speed": 10.0, "timer": 1.05}, {"s": 30.0, "d": -3.5, "speed": 6.0}]
    world = one_world(FAR_BEHIND, [*left, *right])
    decided(world, True)
    assert world.vehicles.target_lane[0].tolist() == [1, 2, 1, 0]
    decided(world, True)
    assert world.vehicles.target_lane[0].tolist() == [1, 2, 0, 0]


@kernels
def test_one_step_of_the_traffic_by_hand() -> None:
    steered = {"s": 0.0, "d": 1.0, "speed": 10.0, "heading": 0.1, "acceleration": 2.0, "timer": 0.4}
    world = one_world(None, [{**steered, "steering": math.atan(2.0 * math.tan(0.02))}, {"s": 9.0, "present": 0}])
    move(world.vehicles, 0, True)
    car = world.vehicles[0, 0]
    assert car.s == pytest.approx(math.cos(0.12))
    assert car.d == pytest.approx(1.0 + math.sin(0.12))
    assert car.heading == pytest.approx(0.1 + 10.0 * math.sin(0.02) / 2.5 * 0.1)
    assert (car.speed, car.timer) == pytest.approx((10.2, 0.5))
    assert world.vehicles.s[0, 1] == 9.0


@kernels
def test_lane_keeping_traffic_moves_straight() -> None:
    world = one_world(None, [{"s": 3.0, "d": 3.5, "speed": 10.0, "acceleration": -1.0, "timer": 0.4}])
    move(world.vehicles, 0, False)
    car = world.vehicles[0, 0]
    assert (car.s, car.d, car.speed, car.timer) == pytest.approx((4.0, 3.5, 9.9, 0.5))


@kernels
@pytest.mark.parametrize("lane_changes", [False, True])
def test_traffic_stops_at_rest_and_its_executed_acceleration_says_so(lane_changes: bool) -> None:
    world = one_world(None, [{"s": 3.0, "speed": 0.2, "acceleration": -6.0}])
    move(world.vehicles, 0, lane_changes)
    car = world.vehicles[0, 0]
    assert (car.s, car.speed, car.acceleration) == pytest.approx((3.02, 0.0, -2.0))


@settings(max_examples=25)
@given(
    st.lists(st.tuples(st.floats(20.0, 60.0), st.floats(8.0, 12.0)), min_size=2, max_size=6),
    st.floats(0.0, 1.0),
)
def test_a_platoon_behind_a_stopping_leader_never_collides_nor_reverses(
    cars: list[tuple[float, float]], braking: float
) -> None:
    positions = np.cumsum([gap for gap, _ in cars])[::-1]
    vehicles = [{"s": float(s), "speed": v} for s, (_, v) in zip(positions, cars, strict=True)]
    world = one_world({"s": -500.0}, vehicles)
    world.vehicles.desired_speed[0, 0] = 12.0 * braking
    for _ in range(300):
        before = world.vehicles.s.copy()
        decided(world)
        move(world.vehicles, 0, False)
        assert (world.vehicles.s >= before).all()
        assert (world.vehicles.speed >= 0.0).all()
        assert (-np.diff(world.vehicles.s[0]) > 5.0).all()

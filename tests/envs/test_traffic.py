"""A step of the traffic: steering into lanes, decisions in turn, motion; held against highway-env elsewhere."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.motion import STEERING_MAX_RAD
from envs.traffic import decide, idm_acceleration, lane_steering, move
from envs.world import CROSSING, World
from tests.envs.small_worlds import FAR_BEHIND, one_world, people

kernels = pytest.mark.kernels
SPEEDS = st.floats(0.0, 14.0)


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

"""The state vector of Table I: every entry, its order, its masks and its way back to SI units."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.observation import OBSERVATION_SIZE, decode, observation_bounds, write_observation
from envs.world import CROSSING, GONE, WAITING, World
from tests.envs.small_worlds import one_world

pytestmark = pytest.mark.kernels


def state(world: World) -> np.ndarray:
    row = np.full(OBSERVATION_SIZE, np.nan, np.float32)
    slots, keys = np.empty(8, np.int64), np.empty(8)
    write_observation(world.ego, world.vehicles, world.pedestrians, 0, row, slots, keys)
    return row


def test_the_state_vector_by_hand() -> None:
    ego = {"s": 380.0, "d": -1.75, "speed": 10.0, "heading": 0.1, "lateral_speed": 0.8}
    car = {"s": 430.0, "d": 3.5, "speed": 12.0, "heading": -0.2}
    walker = {"state": CROSSING, "s": 360.0, "d": 1.4, "lateral_speed": -1.2}
    x = state(one_world(ego, [car], [walker]))
    expected = np.zeros(47)
    expected[:5] = [0.5, -0.5, 10.0 / 13.89, 0.8, 0.1]
    # 50 of 200 m, 5.25 of 10.5 m, speeds along the road in 11.11 m/s, across it in m/s.
    along = (12.0 * math.cos(0.2) - 10.0 * math.cos(0.1)) / 11.11
    expected[5:10] = [0.25, 0.5, along, -12.0 * math.sin(0.2) - 0.8, -0.2]
    expected[30:33] = [-0.1, 0.3, -1.2]
    expected[39] = expected[44] = 1.0
    np.testing.assert_allclose(x, expected, rtol=1e-6, atol=1e-7)


def test_slots_hold_the_nearest_bodies_in_order_of_distance_along_the_road() -> None:
    distances = [90.0, -10.0, 150.0, 30.0, -60.0, 20.0, -199.0]
    cars = [{"s": 300.0 + ds, "d": 3.5} for ds in distances]
    people = [{"state": CROSSING, "s": 300.0 + ds} for ds in (70.0, -5.0, 40.0, 120.0)]
    x = state(one_world({"s": 300.0}, cars, people))
    assert (200.0 * x[5:30:5]).tolist() == pytest.approx([-10.0, 20.0, 30.0, -60.0, 90.0])
    assert (200.0 * x[30:39:3]).tolist() == pytest.approx([-5.0, 40.0, 70.0])
    assert x[39:].tolist() == [1.0] * 8


def test_bodies_at_the_same_distance_keep_their_order() -> None:
    x = state(one_world({"s": 0.0}, [{"s": 40.0, "d": 3.5}, {"s": -40.0, "d": 0.0}]))
    assert (200.0 * x[5:15:5]).tolist() == pytest.approx([40.0, -40.0])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_bodies_are_seen_up_to_200_m(side: float) -> None:
    near, far = side * 200.0, side * 200.0001
    x = state(one_world({}, [{"s": near}, {"s": far}], [{"state": CROSSING, "s": s} for s in (far, near)]))
    assert x[39:].tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    assert x[5] == x[30] == side


def test_empty_slots_are_zero_and_masked_never_a_far_car() -> None:
    absent = {"s": 10.0, "present": 0, "speed": 9.0}
    people = [{"state": s, "s": 10.0, "d": 5.75, "lateral_speed": -1.0} for s in (WAITING, GONE)]
    x = state(one_world({"s": 1.0}, [absent], people))
    assert (x[5:] == 0.0).all()


def test_bounds_fit_the_layout_and_contain_an_ego_that_left_the_road() -> None:
    low, high = observation_bounds()
    assert low.shape == high.shape == (47,)
    assert (low < high).all()
    assert (low[39:].tolist(), high[39:].tolist()) == ([0.0] * 8, [1.0] * 8)
    # The last step at v_max moves 1.389 m along and at most 0.48 m across.
    x = state(one_world({"s": 761.3, "d": -5.25 - 0.48, "speed": 13.89, "heading": -0.35, "lateral_speed": -4.8}))
    assert (x >= low).all()
    assert (x <= high).all()


@given(
    st.tuples(st.floats(0, 761), st.floats(-5.25, 5.25), st.floats(0, 13.89), st.floats(-0.35, 0.35)),
    st.lists(st.tuples(st.floats(-250, 250), st.floats(-4, 4), st.floats(0, 13.89)), max_size=7),
    st.lists(st.tuples(st.floats(-250, 250), st.floats(-5.8, 5.8), st.floats(-1.8, 1.8)), max_size=4),
)
def test_decode_gives_the_bodies_back_in_si_units(
    ego: tuple[float, ...], cars: list[tuple[float, ...]], people: list[tuple[float, ...]]
) -> None:
    s, d, speed, heading = ego
    world = one_world(
        {"s": s, "d": d, "speed": speed, "heading": heading, "lateral_speed": 0.3},
        [{"s": s + ds, "d": dc, "speed": v} for ds, dc, v in cars],
        [{"state": CROSSING, "s": s + ds, "d": dp, "lateral_speed": v} for ds, dp, v in people],
    )
    x = state(world)
    low, high = observation_bounds()
    assert (x >= low).all()
    assert (x <= high).all()
    o = decode(x[None])
    found = [o.s[0], o.d[0], o.speed[0], o.heading[0], o.lateral_speed[0]]
    assert found == pytest.approx([s, d, speed, heading, 0.3], abs=1e-4)

    def nearest(bodies: list[tuple[float, ...]], slots: int) -> np.ndarray:
        ds = [world.ego.s[0] + b[0] - world.ego.s[0] for b in bodies]
        seen = sorted((k for k in range(len(bodies)) if abs(ds[k]) <= 200.0), key=lambda k: abs(ds[k]))
        return np.array([bodies[k] for k in seen[:slots]]).reshape(-1, 3)

    expected = nearest(cars, 5)
    present = o.vehicle_present[0]
    assert present.tolist() == [k < len(expected) for k in range(5)]
    np.testing.assert_allclose(o.vehicle_ds[0][present], expected[:, 0], atol=1e-3)
    np.testing.assert_allclose(o.vehicle_dd[0][present], expected[:, 1] - d, atol=1e-3)
    np.testing.assert_allclose(o.vehicle_dv[0][present], expected[:, 2] - speed * math.cos(heading), atol=1e-3)
    expected = nearest(people, 3)
    present = o.pedestrian_present[0]
    assert present.tolist() == [k < len(expected) for k in range(3)]
    np.testing.assert_allclose(o.pedestrian_ds[0][present], expected[:, 0], atol=1e-3)
    np.testing.assert_allclose(o.pedestrian_dd[0][present], expected[:, 1] - d, atol=1e-3)
    np.testing.assert_allclose(o.pedestrian_speed[0][present], expected[:, 2], atol=1e-5)

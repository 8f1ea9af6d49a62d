"""The ego's plans, its tracking and its bicycle model: hand values and the paper's matrices."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.motion import (
    COURSE_MAX_RAD,
    HORIZON_S,
    LATERAL_ACCELERATION_MAX_MPS2,
    STEERING_MAX_RAD,
    TARGET_MAX_M,
    feasible_horizon,
    move_ego,
    plan_lateral,
    planned_acceleration,
    quartic_coefficients,
    quintic_coefficients,
    steer,
)
from tests.envs.small_worlds import one_world

pytestmark = pytest.mark.kernels

RATES = st.floats(-5.0, 5.0)
HORIZONS = st.floats(0.5, 7.0)


def paper_quintic(t: float) -> np.ndarray:
    """The matrix of the paper's Eq. (cal_polynomials 1)."""
    return np.array(
        [
            [1, 0, 0, 0, 0, 0],
            [0, 1, 0, 0, 0, 0],
            [0, 0, 2, 0, 0, 0],
            [1, t, t**2, t**3, t**4, t**5],
            [0, 1, 2 * t, 3 * t**2, 4 * t**3, 5 * t**4],
            [0, 0, 2, 6 * t, 12 * t**2, 20 * t**3],
        ]
    )


def paper_quartic(t: float) -> np.ndarray:
    """The matrix of the paper's Eq. (cal_polynomials 2)."""
    return np.array(
        [
            [1, 0, 0, 0, 0],
            [0, 1, 0, 0, 0],
            [0, 0, 2, 0, 0],
            [0, 1, 2 * t, 3 * t**2, 4 * t**3],
            [0, 0, 2, 6 * t, 12 * t**2],
        ]
    )


def test_quintic_from_rest_to_rest_by_hand() -> None:
    # x = 16 m in T = 2 s: 10 x / T^3 = 20, -15 x / T^4 = -15, 6 x / T^5 = 3.
    assert quintic_coefficients(1.0, 0.0, 0.0, 17.0, 2.0) == pytest.approx((1.0, 0.0, 0.0, 20.0, -15.0, 3.0))


@given(RATES, RATES, RATES, RATES, HORIZONS)
def test_quintic_solves_the_papers_matrix(d: float, v: float, a: float, target: float, t: float) -> None:
    expected = np.linalg.solve(paper_quintic(t), [d, v, a, target, 0.0, 0.0])
    np.testing.assert_allclose(quintic_coefficients(d, v, a, target, t), expected, rtol=1e-7, atol=1e-7)


def test_quartic_from_rest_by_hand() -> None:
    # 8 m/s in T = 2 s: c3 = 8 / T^2 = 2, c4 = -8 / (2 T^3) = -0.5. Speed at T: 3 c3 T^2 + 4 c4 T^3 = 24 - 16 = 8.
    assert quartic_coefficients(3.0, 0.0, 0.0, 8.0, 2.0) == pytest.approx((3.0, 0.0, 0.0, 2.0, -0.5))


@given(RATES, RATES, RATES, RATES, HORIZONS)
def test_quartic_solves_the_papers_matrix(s: float, v: float, a: float, target: float, t: float) -> None:
    expected = np.linalg.solve(paper_quartic(t), [s, v, a, target, 0.0])
    np.testing.assert_allclose(quartic_coefficients(s, v, a, target, t), expected, rtol=1e-7, atol=1e-7)


def test_planned_acceleration_is_the_quartics_one_step_ahead() -> None:
    # From rest to 8 m/s in 2 s, see above: 6 c3 t + 12 c4 t^2 at t = 0.1 s is 1.2 - 0.06.
    assert planned_acceleration(0.0, 0.0, 8.0, 2.0) == pytest.approx(1.14)
    # From 10 m/s at 1 m/s2 towards 10 m/s in 2 s: dv = -2, da = -1, c2 = 0.5, c3 = (-6 + 2) / 12 = -1 / 3,
    # c4 = (4 - 2) / 32 = 1 / 16: 1 - 0.2 + 0.0075.
    assert planned_acceleration(10.0, 1.0, 10.0, 2.0) == pytest.approx(0.8075)


def test_feasible_horizon_of_a_lane_change_by_hand() -> None:
    # sqrt(10 / sqrt(3) x 3.5 m / 3 m/s2) = sqrt(6.7358) = 2.5953 s.
    assert feasible_horizon(3.5, 0.5) == pytest.approx(2.59534, abs=1e-5)
    assert feasible_horizon(-3.5, 0.5) == feasible_horizon(3.5, 0.5)
    assert feasible_horizon(3.5, 4.0) == 4.0


@given(st.floats(0.1, 10.0), st.floats(0.1, 7.0))
def test_lateral_acceleration_of_a_feasible_plan_peaks_at_the_limit_at_most(x: float, asked: float) -> None:
    horizon = feasible_horizon(x, asked)
    _, _, _, c3, c4, c5 = quintic_coefficients(0.0, 0.0, 0.0, x, horizon)
    t = np.linspace(0.0, horizon, 2001)
    peak = np.abs(6 * c3 * t + 12 * c4 * t**2 + 20 * c5 * t**3).max()
    assert peak <= LATERAL_ACCELERATION_MAX_MPS2 + 1e-9
    assert horizon >= asked
    if horizon > asked:
        assert peak == pytest.approx(LATERAL_ACCELERATION_MAX_MPS2, rel=1e-4)


def test_one_step_of_the_lateral_plan_by_hand() -> None:
    # 0.5 m in 2 s: c3 = 0.625, c4 = -0.46875, c5 = 0.09375. At t = 0.1 s the rate is
    # 3 c3 t^2 + 4 c4 t^3 + 5 c5 t^4 = 0.01875 - 0.001875 + 0.000046875, its change 6 c3 t + 12 c4 t^2 + 20 c5 t^3 =
    # 0.375 - 0.05625 + 0.001875; the position follows by the trapezoid rule.
    world = one_world({"speed": 10.0, "d": 1.0})
    plan_lateral(world.ego, 0, 1.5, 2.0)
    assert world.ego.reference_speed[0] == pytest.approx(0.016921875)
    assert world.ego.reference_acceleration[0] == pytest.approx(0.320625)
    assert world.ego.reference_d[0] == pytest.approx(1.0 + 0.5 * 0.016921875 * 0.1)


def test_the_lateral_plan_starts_from_its_own_rate_and_acceleration() -> None:
    # No way to go in 2 s, but moving at 0.4 m/s with -0.2 m/s2: dx = -0.4, dv = 0, da = 0.2 in the closed form.
    expected = np.linalg.solve(paper_quintic(2.0), [1.0, 0.4, -0.2, 1.0, 0.0, 0.0])
    world = one_world({"speed": 10.0, "d": 1.0, "reference_speed": 0.4, "reference_acceleration": -0.2})
    plan_lateral(world.ego, 0, 1.0, 2.0)
    rate = np.polynomial.Polynomial(expected).deriv()(0.1)
    assert world.ego.reference_speed[0] == pytest.approx(rate)
    assert world.ego.reference_acceleration[0] == pytest.approx(np.polynomial.Polynomial(expected).deriv(2)(0.1))
    assert world.ego.reference_d[0] == pytest.approx(1.0 + 0.05 * (0.4 + rate))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_plan_never_moves_sideways_faster_than_the_car_can_point(side: float) -> None:
    world = one_world({"speed": 2.0, "reference_speed": side * 1.2, "reference_acceleration": side})
    plan_lateral(world.ego, 0, side * 3.5, 0.5)
    assert world.ego.reference_speed[0] == pytest.approx(side * 2.0 * math.sin(COURSE_MAX_RAD))
    assert world.ego.reference_acceleration[0] == 0.0


def test_one_step_of_tracking_by_hand() -> None:
    # The plan stands at 0 and stays; the ego is at 0.2 m: error -0.2 m. Integral 0.3 - 0.02 = 0.28 m s,
    # derivative (-0.2 + 0.1) / 0.1 = -1 m/s. Rate -0.2 + 0.1 x 0.28 - 0.05 = -0.222 m/s at 10 m/s: a course of
    # asin(-0.0222), reached from heading 0.05 rad by a slip angle of course - 0.05.
    start = {"speed": 10.0, "d": 0.2, "heading": 0.05, "reference_d": 0.0}
    world = one_world({**start, "error_integral": 0.3, "error_previous": -0.1})
    steering = steer(world.ego, 0, 0.0, 3.0)
    assert steering == pytest.approx(math.atan(2.0 * math.tan(math.asin(-0.0222) - 0.05)))
    assert world.ego.error_integral[0] == pytest.approx(0.28)
    assert world.ego.error_previous[0] == pytest.approx(-0.2)


def test_the_plans_own_motion_is_fed_forward() -> None:
    # On its plan, which moves by 0.05 (0.4 + rate) over the next 0.1 s, see above.
    start = {"speed": 10.0, "d": 1.0, "reference_speed": 0.4, "reference_acceleration": -0.2}
    world = one_world(start)
    before = world.ego.d[0]
    steering = steer(world.ego, 0, 1.0, 2.0)
    move_ego(world.ego, 0, steering, 0.0)
    assert world.ego.d[0] - before == pytest.approx(world.ego.reference_d[0] - before)
    assert world.ego.d[0] - before > 0.03


@given(st.floats(3.0, 13.89), st.floats(-0.3, 0.3), st.floats(-0.2, 0.2), st.floats(-4.25, 4.25))
def test_steering_gives_the_course_that_the_controller_asks_for(
    speed: float, offset: float, heading: float, target: float
) -> None:
    world = one_world({"speed": speed, "d": offset, "heading": heading, "reference_d": 0.0})
    steering = steer(world.ego, 0, target, 3.0)
    # Proportional, integral of one step and derivative from no error before; the plan's own motion is added.
    rate = world.ego.reference_d[0] / 0.1 - offset * (1.0 + 0.1 * 0.1 + 0.05 / 0.1)
    course = math.asin(np.clip(rate / speed, -math.sin(COURSE_MAX_RAD), math.sin(COURSE_MAX_RAD)))
    before = world.ego.d[0]
    move_ego(world.ego, 0, steering, 0.0)
    assert world.ego.d[0] - before == pytest.approx(0.1 * speed * math.sin(course), abs=1e-9)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_course_and_steering_angle_are_limited(side: float) -> None:
    far_off = one_world({"speed": 5.0, "d": -side * 4.0, "reference_d": side * 4.0})
    expected = side * math.atan(2.0 * math.tan(COURSE_MAX_RAD))
    assert steer(far_off.ego, 0, side * 4.0, 3.0) == pytest.approx(expected)
    askew = one_world({"speed": 5.0, "heading": -side * 1.2})
    assert steer(askew.ego, 0, 0.0, 3.0) == side * STEERING_MAX_RAD


def test_one_step_of_the_bicycle_by_hand() -> None:
    # Steering with half its tangent equal to tan(0.02): slip angle 0.02 rad, course 0.12 rad.
    world = one_world({"s": 5.0, "d": 1.0, "speed": 10.0, "heading": 0.1})
    move_ego(world.ego, 0, math.atan(2.0 * math.tan(0.02)), 1.5)
    ego = world.ego
    assert ego.s[0] == pytest.approx(5.0 + math.cos(0.12))
    assert ego.d[0] == pytest.approx(1.0 + math.sin(0.12))
    assert ego.heading[0] == pytest.approx(0.1 + 10.0 * math.sin(0.02) / 2.5 * 0.1)
    assert ego.speed[0] == pytest.approx(10.15)
    assert ego.lateral_speed[0] == pytest.approx(10.0 * math.sin(0.12))
    assert ego.acceleration[0] == 1.5


@pytest.mark.parametrize(
    ("speed", "command", "after", "executed"),
    [
        (13.85, 2.0, 13.89, 0.4),  # 0.04 m/s are left to the cap
        (0.1, -2.0, 0.0, -1.0),
        (0.0, -2.0, 0.0, 0.0),
        (13.89, 2.0, 13.89, 0.0),
        (5.0, -2.0, 4.8, -2.0),
    ],
)
def test_speed_stays_between_rest_and_50_kmh_and_the_executed_acceleration_says_so(
    speed: float, command: float, after: float, executed: float
) -> None:
    world = one_world({"speed": speed})
    move_ego(world.ego, 0, 0.0, command)
    assert world.ego.speed[0] == pytest.approx(after, abs=1e-12)
    assert world.ego.acceleration[0] == pytest.approx(executed, abs=1e-9)
    assert 0.0 <= world.ego.speed[0] <= 13.89 + 1e-12


@given(st.floats(0.0, 13.89), st.floats(-0.5, 0.5), st.floats(-1.0, 1.0), st.floats(-2.0, 2.0))
def test_the_bicycle_is_the_same_in_a_mirror(speed: float, heading: float, steering: float, a: float) -> None:
    left, right = (one_world({"speed": speed, "heading": side * heading}) for side in (1.0, -1.0))
    move_ego(left.ego, 0, steering, a)
    move_ego(right.ego, 0, -steering, a)
    for name in ("d", "heading", "lateral_speed"):
        assert left.ego[name][0] == -right.ego[name][0]
    for name in ("s", "speed"):
        assert left.ego[name][0] == right.ego[name][0]


def test_limits_are_those_of_the_reference() -> None:
    assert (HORIZON_S, COURSE_MAX_RAD, LATERAL_ACCELERATION_MAX_MPS2, TARGET_MAX_M) == (3.0, 0.35, 3.0, 4.25)
    assert math.degrees(STEERING_MAX_RAD) == pytest.approx(60.0)

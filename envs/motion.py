"""The ego's motion: quintic and quartic plans, PID tracking, bicycle model."""

from __future__ import annotations

import math
from typing import Final

from envs.compiled import njit
from envs.geometry import ROAD_EDGE_M, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M
from envs.scenario import EGO_SPEED_MAX_MPS, STEP_S
from envs.world import Records

ACCELERATION_MAX_MPS2: Final = 2.0
ACCELERATION_MIN_MPS2: Final = -2.0
HORIZON_S: Final = 3.0
"""Lateral planning horizon where no guard asks for a longer one [s]."""
LATERAL_ACCELERATION_MAX_MPS2: Final = 3.0
COURSE_MAX_RAD: Final = 0.35
"""Largest angle between the ego's velocity and the road."""
TARGET_MAX_M: Final = ROAD_EDGE_M - VEHICLE_WIDTH_M / 2
"""Lateral targets are clipped so that the body stays on the road [m]."""
STEERING_MAX_RAD: Final = math.pi / 3
"""highway-env's `ControlledVehicle.MAX_STEERING_ANGLE`."""
# PID of the lateral tracking: 1/s, 1/s2, 1 (the plan's own rate is fed forward).
GAIN_P: Final = 1.0
GAIN_I: Final = 0.1
GAIN_D: Final = 0.05
# Peak acceleration of a rest-to-rest quintic over distance x in time T is PEAK * x / T^2 (10 / sqrt(3)).
QUINTIC_PEAK: Final = 10.0 / math.sqrt(3.0)


@njit
def quintic_coefficients(
    d0: float, speed: float, acceleration: float, target: float, horizon: float
) -> tuple[float, float, float, float, float, float]:
    """Coefficients of the quintic from (d0, speed, acceleration) to (target, 0, 0) within the horizon.

    Source: paper, appendix, Eq. (cal_polynomials 1), solved in closed form.

    Args:
        d0: Lateral position now [m].
        speed: Its rate [m/s].
        acceleration: Its second derivative [m/s2].
        target: Lateral position at the end [m].
        horizon: Planning time [s], > 0.

    Returns:
        p_d in ascending powers of t.
    """
    t = horizon
    dx = target - d0 - speed * t - 0.5 * acceleration * t * t
    dv = -speed - acceleration * t
    da = -acceleration
    c3 = (10.0 * dx - 4.0 * dv * t + 0.5 * da * t * t) / t**3
    c4 = (-15.0 * dx + 7.0 * dv * t - da * t * t) / t**4
    c5 = (6.0 * dx - 3.0 * dv * t + 0.5 * da * t * t) / t**5
    return d0, speed, 0.5 * acceleration, c3, c4, c5


@njit
def quartic_coefficients(
    s0: float, speed: float, acceleration: float, target_speed: float, horizon: float
) -> tuple[float, float, float, float, float]:
    """Coefficients of the quartic from (s0, speed, acceleration) to (target_speed, 0) within the horizon.

    Source: paper, appendix, Eq. (cal_polynomials 2), solved in closed form. Units as in `quintic_coefficients`.

    Returns:
        p_s in ascending powers of t.
    """
    t = horizon
    dv = target_speed - speed - acceleration * t
    da = -acceleration
    c3 = (3.0 * dv - da * t) / (3.0 * t * t)
    c4 = (-2.0 * dv + da * t) / (4.0 * t**3)
    return s0, speed, 0.5 * acceleration, c3, c4


@njit
def planned_acceleration(speed: float, acceleration: float, target_speed: float, horizon: float) -> float:
    """Acceleration that the quartic asks for one step ahead [m/s2]."""
    _, _, c2, c3, c4 = quartic_coefficients(0.0, speed, acceleration, target_speed, horizon)
    t = STEP_S
    return 2.0 * c2 + 6.0 * c3 * t + 12.0 * c4 * t * t


@njit
def feasible_horizon(distance: float, horizon: float) -> float:
    """The horizon, stretched until the quintic stays within the lateral acceleration limit [s].

    Deviation from the paper, which would move 3.5 m sideways in T_c = 0.5 s at 81 m/s2.
    """
    return max(horizon, math.sqrt(QUINTIC_PEAK * abs(distance) / LATERAL_ACCELERATION_MAX_MPS2))


@njit
def plan_lateral(ego: Records, i: int, target: float, horizon: float) -> None:
    """Advance ego i's lateral reference by one step along the quintic to the target [m]."""
    e = ego[i]
    d, v, a = e.reference_d, e.reference_speed, e.reference_acceleration
    _, _, c2, c3, c4, c5 = quintic_coefficients(d, v, a, target, feasible_horizon(target - d, horizon))
    t = STEP_S
    next_v = v + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)))
    next_a = 2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5))
    # A car can move sideways only as fast as it can point its velocity there.
    limit = e.speed * math.sin(COURSE_MAX_RAD)
    if abs(next_v) > limit:
        next_v = math.copysign(limit, next_v)
        next_a = 0.0
    ego[i].reference_d = d + 0.5 * (v + next_v) * t
    ego[i].reference_speed = next_v
    ego[i].reference_acceleration = next_a


@njit
def steer(ego: Records, i: int, target: float, horizon: float) -> float:
    """Plan ego i's next step towards the target and return the steering angle that tracks it [rad].

    A PID controller on the lateral error, with the plan's displacement over the step fed forward.
    """
    before = ego[i].reference_d
    error = before - ego[i].d
    plan_lateral(ego, i, target, horizon)
    integral = ego[i].error_integral + error * STEP_S
    derivative = (error - ego[i].error_previous) / STEP_S
    rate = (ego[i].reference_d - before) / STEP_S + GAIN_P * error + GAIN_I * integral + GAIN_D * derivative
    ego[i].error_integral = integral
    ego[i].error_previous = error
    limit = math.sin(COURSE_MAX_RAD)
    ratio = rate / max(ego[i].speed, 1e-3)
    course = math.asin(min(max(ratio, -limit), limit))
    # Velocity points along heading + slip angle: choose the slip angle that gives the course asked for.
    steering = math.atan(2.0 * math.tan(course - ego[i].heading))
    return min(max(steering, -STEERING_MAX_RAD), STEERING_MAX_RAD)


@njit
def move_ego(ego: Records, i: int, steering: float, acceleration: float) -> None:
    """Kinematic bicycle step of ego i, explicit Euler in the order position, heading, speed.

    Source: highway-env `Vehicle.step`. Deviation: speed stays within 0 and 13.89 m/s, by the acceleration.

    Args:
        ego: `EGO` records, shape (N,).
        i: World.
        steering: Front wheel angle [rad].
        acceleration: Commanded acceleration, already within [-2, 2] [m/s2].
    """
    e = ego[i]
    v, heading = e.speed, e.heading
    a = min(max(acceleration, -v / STEP_S), (EGO_SPEED_MAX_MPS - v) / STEP_S)
    slip = math.atan(0.5 * math.tan(steering))
    lateral_speed = v * math.sin(heading + slip)
    ego[i].s = e.s + v * math.cos(heading + slip) * STEP_S
    ego[i].d = e.d + lateral_speed * STEP_S
    ego[i].heading = heading + v * math.sin(slip) / (VEHICLE_LENGTH_M / 2) * STEP_S
    ego[i].speed = max(v + a * STEP_S, 0.0)
    ego[i].lateral_speed = lateral_speed
    ego[i].acceleration = a

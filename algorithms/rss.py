"""Safe distances of Responsibility-Sensitive Safety.

Source: Shalev-Shwartz, Shammah and Shashua, "On a Formal Model of Safe and Scalable Self-driving Cars" (2017),
arXiv:1708.06374: Lemma 2 (longitudinal) and Definition 6 (lateral). Two cars are in danger only where both distances
are too short at once.
"""

from __future__ import annotations

from typing import Final

from algorithms.critical_acceleration import FOLLOWER_BRAKING_MPS2, TRAFFIC_BRAKING_MPS2
from envs.compiled import njit
from envs.motion import ACCELERATION_MAX_MPS2, ACCELERATION_MIN_MPS2, LATERAL_ACCELERATION_MAX_MPS2
from envs.traffic import COMFORT_ACCELERATION_MPS2

RESPONSE_S: Final = 0.2
"""rho, of every car: a step of 0.1 s until guard or IDM acts, and another because motion goes in steps."""
LATERAL_BRAKING_MPS2: Final = 1.0
"""Lateral braking that every car is sure to bring up."""
FLUCTUATION_M: Final = 0.2
"""mu: lateral distance that is left when both have come to rest sideways."""


@njit
def longitudinal_safe_distance(
    rear_speed: float, front_speed: float, response: float, acceleration: float, braking_min: float, braking_max: float
) -> float:
    """Bumper gap from which the rear car cannot run into the front one, Lemma 2 [m].

    d = [v_r rho + a rho^2 / 2 + (v_r + rho a)^2 / (2 b_min) - v_f^2 / (2 b_max)]_+: the front car brakes as hard as it
    can, the rear one accelerates for the response time and then brakes at least as hard as it must.

    Args:
        rear_speed: v_r, >= 0 [m/s].
        front_speed: v_f, >= 0 [m/s].
        response: rho, of the rear car [s].
        acceleration: a_max,accel of the rear car [m/s2].
        braking_min: b_min,brake of the rear car, > 0 [m/s2].
        braking_max: b_max,brake of the front car, > 0 [m/s2].
    """
    after = rear_speed + response * acceleration
    distance = (
        0.5 * (rear_speed + after) * response
        + after * after / (2.0 * braking_min)
        - front_speed * front_speed / (2.0 * braking_max)
    )
    return max(distance, 0.0)


@njit
def lateral_safe_distance(
    own: float, other: float, response: float, acceleration: float, braking_min: float, fluctuation: float
) -> float:
    """Lateral gap from which two bodies cannot touch sideways, Definition 6 [m].

    d = mu + [(v_1 + v_1') rho / 2 + v_1'^2 / (2 b) + the same of the other]_+ with v' = v + rho a: both accelerate
    towards each other for the response time and then brake. Deviation: v' |v'| for v'^2, so that one who moves away
    adds no distance (the paper has the two approach).

    Args:
        own: Lateral speed towards the other, < 0 away from it [m/s].
        other: The other's lateral speed towards the own body [m/s].
        response: rho [s].
        acceleration: a_lat,max,accel [m/s2].
        braking_min: b_lat,min,brake, > 0 [m/s2].
        fluctuation: mu [m].
    """
    own_after, other_after = own + response * acceleration, other + response * acceleration
    way = 0.5 * response * (own + own_after + other + other_after)
    way += (own_after * abs(own_after) + other_after * abs(other_after)) / (2.0 * braking_min)
    return fluctuation + max(way, 0.0)


@njit
def gap_needed_ahead(speed: float, leader_speed: float) -> float:
    """Bumper gap that the ego owes to a body ahead [m]; speeds along the road, >= 0 [m/s]."""
    return longitudinal_safe_distance(
        speed, leader_speed, RESPONSE_S, ACCELERATION_MAX_MPS2, -ACCELERATION_MIN_MPS2, TRAFFIC_BRAKING_MPS2
    )


@njit
def gap_needed_behind(speed: float, follower_speed: float) -> float:
    """Bumper gap that a follower needs behind the ego [m]; speeds along the road, >= 0 [m/s]."""
    return longitudinal_safe_distance(
        follower_speed, speed, RESPONSE_S, COMFORT_ACCELERATION_MPS2, FOLLOWER_BRAKING_MPS2, -ACCELERATION_MIN_MPS2
    )


@njit
def gap_needed_beside(own: float, other: float) -> float:
    """Lateral gap between two cars [m]; lateral speeds towards each other [m/s]."""
    return lateral_safe_distance(
        own, other, RESPONSE_S, LATERAL_ACCELERATION_MAX_MPS2, LATERAL_BRAKING_MPS2, FLUCTUATION_M
    )

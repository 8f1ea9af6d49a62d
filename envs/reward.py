"""Reward terms and what cost signals see, per simulation step of 0.1 s."""

from __future__ import annotations

import math
from typing import Final

from envs.compiled import njit
from envs.geometry import (
    PEDESTRIAN_SIZE_M,
    VEHICLE_LENGTH_M,
    VEHICLE_WIDTH_M,
    bumper_gap,
    lane_centre,
    nearest_lane,
)
from envs.scenario import EGO_SPEED_MAX_MPS, LANE_WIDTH_M
from envs.world import CROSSING, Records

# Coefficients of the paper's reward tables.
START_REWARD: Final = 0.5
MAINTAIN_REWARD: Final = 4.0
COLLISION_REWARD: Final = -50.0
LANE_DEVIATION_REWARD: Final = -1.0
RISK_REWARD: Final = -5.0
COMFORT_REWARD: Final = -0.5
SPEED_START_MPS: Final = 8.0
"""v_smin: below it the starting phase, above it the maintaining phase."""
COMFORT_ACCELERATION_MPS2: Final = 4.0
"""a-bar of Eq. (safety_reward)."""
SAFE_HEADWAY_S: Final = 3.6
"""S_safe = 3.6 v (paper, Sec. IV-B)."""
LOW_TTC_S: Final = 1.5


@njit
def speed_reward(speed: float) -> float:
    """r_s, in two phases: 0.5 for reaching 8 m/s, 4 more on the way to 13.89 m/s (paper, appendix)."""
    start = min(max(speed / SPEED_START_MPS, 0.0), 1.0)
    maintain = min(max((speed - SPEED_START_MPS) / (EGO_SPEED_MAX_MPS - SPEED_START_MPS), 0.0), 1.0)
    return START_REWARD * start + MAINTAIN_REWARD * maintain


@njit
def lane_deviation_reward(d: float) -> float:
    """r_ld: -1 per metre between the ego and the nearest lane's centre (paper, appendix)."""
    return LANE_DEVIATION_REWARD * abs(d - lane_centre(nearest_lane(d)))


@njit
def comfort_reward(target: float, target_before: float, acceleration: float, acceleration_before: float) -> float:
    """r_cf of Eq. (safety_reward), on executed commands.

    Deviation: lateral targets are compared in the road's frame. Relative to the nearest lane the paper's d_fn
    jumps by 3.5 m in the middle of every lane change, though nothing moves.

    Args:
        target: Lateral target [m].
        target_before: That of the step before [m].
        acceleration: Acceleration command [m/s2].
        acceleration_before: That of the step before [m/s2].
    """
    lateral = abs(target - target_before) / (2.0 * LANE_WIDTH_M)
    longitudinal = abs(acceleration - acceleration_before) / COMFORT_ACCELERATION_MPS2
    return COMFORT_REWARD * (lateral + longitudinal)


@njit
def path_exposure(ego: Records, vehicles: Records, pedestrians: Records, i: int) -> tuple[float, float]:
    """Smallest bumper gap [m] and time to collision [s] to bodies ahead that overlap ego i's width; inf if none."""
    e = ego[i]
    speed = e.speed * math.cos(e.heading)
    gap_min, ttc_min = math.inf, math.inf
    for j in range(vehicles.shape[1]):
        v = vehicles[i, j]
        if v.present == 0 or v.s <= e.s or abs(v.d - e.d) >= VEHICLE_WIDTH_M:
            continue
        gap = max(bumper_gap(v.s - e.s, VEHICLE_LENGTH_M), 0.0)
        gap_min = min(gap_min, gap)
        closing = speed - v.speed * math.cos(v.heading)
        if closing > 0.0:
            ttc_min = min(ttc_min, gap / closing)
    for j in range(pedestrians.shape[1]):
        p = pedestrians[i, j]
        if p.state != CROSSING or p.s <= e.s:
            continue
        if abs(p.d - e.d) >= 0.5 * (VEHICLE_WIDTH_M + PEDESTRIAN_SIZE_M):
            continue
        gap = max(bumper_gap(p.s - e.s, PEDESTRIAN_SIZE_M), 0.0)
        gap_min = min(gap_min, gap)
        if speed > 0.0:
            ttc_min = min(ttc_min, gap / speed)
    return gap_min, ttc_min

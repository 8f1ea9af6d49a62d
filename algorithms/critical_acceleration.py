"""Safe critical acceleration, Eq. (SCA), and the braking reserve that makes it a guarantee."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from envs.compiled import njit
from envs.motion import ACCELERATION_MIN_MPS2
from envs.reward import SAFE_HEADWAY_S
from envs.scenario import STEP_S
from envs.world import FloatArray

TRAFFIC_BRAKING_MPS2: Final = 6.0
"""Strongest braking of the traffic (IDM's clip): the worst a leader can do."""
FOLLOWER_BRAKING_MPS2: Final = 5.0
"""Braking that a lane change may ask of the car behind (IDM's comfortable limit)."""
FOLLOWER_REACTION_S: Final = 0.3
CLEARANCE_M: Final = 1.0
"""Bumper gap that is left at standstill, and in front of a follower."""


@njit
def sca(gap: float, safe_gap: float, closing: float, horizon: float) -> float:
    """Eq. (SCA) for one object; arguments as in `critical_acceleration`, gap != 0."""
    sign = 1.0 if gap > 0.0 else -1.0
    return 2.0 * (gap - sign * safe_gap + horizon * closing) / (horizon * horizon)


@njit
def stopping_bound(gap: float, speed: float, leader_speed: float) -> float:
    """Largest acceleration after which the ego can still stop behind a leader that brakes at 6 m/s2 [m/s2].

    Derivation: with v' = v + a dt, braking at -2 m/s2 in steps of dt covers v'^2 / 4 + v' dt / 2; the leader
    still covers v_l^2 / 12. If the bound holds now, -2 m/s2 satisfies it at the next step: it never gives way.

    Args:
        gap: Bumper gap, > 0 [m].
        speed: Ego speed v [m/s].
        leader_speed: v_l, >= 0 [m/s].
    """
    left = gap - CLEARANCE_M - speed * STEP_S + leader_speed * leader_speed / (2.0 * TRAFFIC_BRAKING_MPS2)
    if left <= 0.0:
        # Too late for any: the worse, the less is left.
        return (left / STEP_S - speed) / STEP_S
    b = -ACCELERATION_MIN_MPS2
    # v'^2 / (2 b) + v' dt / 2 = left, solved for v'.
    next_speed = b * (math.sqrt(0.25 * STEP_S * STEP_S + 2.0 * left / b) - 0.5 * STEP_S)
    return (next_speed - speed) / STEP_S


@njit
def follower_can_brake(gap: float, speed: float, follower_speed: float) -> bool:
    """Whether a car behind can stop behind an ego that brakes at -2 m/s2; gap > 0 [m], speeds [m/s]."""
    needed = (
        follower_speed * follower_speed / (2.0 * FOLLOWER_BRAKING_MPS2)
        + FOLLOWER_REACTION_S * follower_speed
        - speed * speed / (-2.0 * ACCELERATION_MIN_MPS2)
    )
    return gap >= max(needed, 0.0) + CLEARANCE_M


def safe_gap(speed_mps: FloatArray) -> FloatArray:
    """S_safe = 3.6 v (paper, Sec. IV-B) [m]."""
    return SAFE_HEADWAY_S * speed_mps


def critical_acceleration(
    gap_m: FloatArray, safe_gap_m: FloatArray, closing_mps: FloatArray, horizon_s: FloatArray
) -> FloatArray:
    """Constant acceleration that restores the safe gap to one object within the horizon.

    Source: paper Eq. (SCA). Deviation: gaps are bumper to bumper, so contact is gap 0.

    Args:
        gap_m: Signed bumper gap, > 0 ahead, < 0 behind, shape (worlds, objects) [m].
        safe_gap_m: Required gap, shape (worlds, 1), >= 0 [m].
        closing_mps: Object speed minus ego speed, shape (worlds, objects) [m/s].
        horizon_s: Adjustment time T_c, shape (worlds, 1), > 0 [s].

    Returns:
        Acceleration, shape (worlds, objects) [m/s2]; -inf where the object overlaps (gap 0).

    Raises:
        ValueError: A horizon is not positive or not finite, or shapes do not broadcast.
    """
    horizon = np.asarray(horizon_s, np.float64)
    bad = ~(np.isfinite(horizon) & (horizon > 0.0))
    if bad.any():
        raise ValueError(f"T_c = {horizon[bad].flat[0]} s: must be positive and finite.")
    gap = np.asarray(gap_m, np.float64)
    acceleration = 2.0 * (gap - np.sign(gap) * safe_gap_m + horizon * closing_mps) / horizon**2
    return np.where(gap == 0.0, -np.inf, acceleration)

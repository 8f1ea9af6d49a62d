"""Safe critical acceleration, Eq. (SCA), and the braking reserve that makes it a guarantee."""

from __future__ import annotations

import math
from typing import Final

from envs.compiled import njit
from envs.motion import ACCELERATION_MIN_MPS2
from envs.scenario import STEP_S

TRAFFIC_BRAKING_MPS2: Final = 6.0
"""Strongest braking of the traffic (IDM's clip): the worst a leader can do."""
FOLLOWER_BRAKING_MPS2: Final = 5.0
"""Braking that a lane change may ask of the car behind (IDM's comfortable limit)."""
FOLLOWER_REACTION_S: Final = 0.3
CLEARANCE_M: Final = 1.0
"""Bumper gap that is left at standstill, and in front of a follower."""


@njit
def sca(gap: float, safe_gap: float, closing: float, horizon: float) -> float:
    """Constant acceleration that restores the safe gap to one object within the horizon [m/s2].

    Source: paper Eq. (SCA). Deviation: gaps are bumper to bumper, so contact is gap 0.

    Args:
        gap: Bumper gap, > 0 ahead, < 0 behind, not 0 [m].
        safe_gap: S_safe, >= 0 [m].
        closing: Object speed minus ego speed [m/s].
        horizon: Adjustment time T_c, > 0 [s].
    """
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

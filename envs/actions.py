"""What a policy's action is, and its bounds."""

from __future__ import annotations

import enum
from typing import Final

import numpy as np
from gymnasium import spaces

from envs.motion import ACCELERATION_MAX_MPS2, ACCELERATION_MIN_MPS2
from envs.scenario import EGO_SPEED_MAX_MPS, LANE_WIDTH_M

HORIZON_MIN_S: Final = 0.5
HORIZON_MAX_S: Final = 4.0
"""Range of T_c in the driving agent's action (paper, appendix) [s]."""


class ActionMode(enum.Enum):
    """What a policy's action is."""

    ACCELERATION = "acceleration"
    """[d_fn, a_x]: lateral offset from the nearest lane's centre [m], acceleration [m/s2]."""
    PLANNING = "planning"
    """[T_c, d_fn, s_dot_f]: planning time [s], lateral offset [m], target speed [m/s]: the driving agent's."""


def action_space(mode: ActionMode) -> spaces.Box:
    """Bounds of an action in physical units."""
    low = [-LANE_WIDTH_M, ACCELERATION_MIN_MPS2]
    high = [LANE_WIDTH_M, ACCELERATION_MAX_MPS2]
    if mode is ActionMode.PLANNING:
        low, high = [HORIZON_MIN_S, -LANE_WIDTH_M, 0.0], [HORIZON_MAX_S, LANE_WIDTH_M, EGO_SPEED_MAX_MPS]
    return spaces.Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)

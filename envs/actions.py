"""Bounds of a policy's action."""

from __future__ import annotations

from typing import Final

import numpy as np
from gymnasium import spaces

from envs.motion import ACCELERATION_MAX_MPS2, ACCELERATION_MIN_MPS2
from envs.scenario import EGO_SPEED_MAX_MPS, LANE_WIDTH_M
from envs.terms import ActionMode

HORIZON_MIN_S: Final = 0.5
HORIZON_MAX_S: Final = 4.0
"""Range of T_c in the driving agent's action (paper, appendix) [s]."""


def action_space(mode: ActionMode) -> spaces.Box:
    """Bounds of an action in physical units."""
    low = [-LANE_WIDTH_M, ACCELERATION_MIN_MPS2]
    high = [LANE_WIDTH_M, ACCELERATION_MAX_MPS2]
    if mode is ActionMode.PLANNING:
        low, high = [HORIZON_MIN_S, -LANE_WIDTH_M, 0.0], [HORIZON_MAX_S, LANE_WIDTH_M, EGO_SPEED_MAX_MPS]
    return spaces.Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)

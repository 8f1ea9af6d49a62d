"""Lanes and oriented rectangles."""

from __future__ import annotations

import math
from typing import Final

from envs.compiled import njit
from envs.scenario import LANE_WIDTH_M, LANES

VEHICLE_LENGTH_M: Final = 5.0
VEHICLE_WIDTH_M: Final = 2.0
"""Size of every car, highway-env's `Vehicle` [m]."""
PEDESTRIAN_SIZE_M: Final = 0.6
"""Side of a pedestrian's square [m]."""
ROAD_EDGE_M: Final = LANE_WIDTH_M * LANES / 2
"""Distance of either road edge from the middle lane's centre [m]."""


@njit
def lane_centre(lane: int) -> float:
    """Lateral position of a lane's centre [m]; lanes 0, 1, 2 lie at -3.5, 0, 3.5."""
    return (lane - (LANES - 1) / 2) * LANE_WIDTH_M


@njit
def nearest_lane(d: float) -> int:
    """Index of the lane whose centre is nearest to lateral position d [m]; ties go to the lower index."""
    lane = math.ceil(d / LANE_WIDTH_M + LANES / 2 - 1.0)
    return min(max(lane, 0), LANES - 1)


@njit
def bumper_gap(ds: float, length: float) -> float:
    """Gap between the ego and a body of that length whose centre is ds ahead (or behind) [m]; < 0: overlap."""
    return abs(ds) - 0.5 * (VEHICLE_LENGTH_M + length)


@njit
def _separated(
    ds: float, dd: float, cos_a: float, sin_a: float, half_length: float, half_width: float,
    cos_b: float, sin_b: float, other_length: float, other_width: float,
) -> bool:  # fmt: skip
    """Whether an axis of rectangle a separates it from rectangle b, whose centre is (ds, dd) away."""
    c = abs(cos_a * cos_b + sin_a * sin_b)
    s = abs(sin_a * cos_b - cos_a * sin_b)
    along = abs(ds * cos_a + dd * sin_a)
    across = abs(dd * cos_a - ds * sin_a)
    return (
        along > half_length + other_length * c + other_width * s
        or across > half_width + other_length * s + other_width * c
    )


@njit
def rectangles_overlap(
    ds: float, dd: float, heading_a: float, length_a: float, width_a: float,
    heading_b: float, length_b: float, width_b: float,
) -> bool:  # fmt: skip
    """True overlap of two oriented rectangles, by the separating axis theorem; touching counts.

    Args:
        ds: Centre of b minus centre of a, along the road [m].
        dd: The same across the road [m].
        heading_a: Heading of a [rad].
        length_a: Length of a [m].
        width_a: Width of a [m].
        heading_b: Heading of b [rad].
        length_b: Length of b [m].
        width_b: Width of b [m].
    """
    reach = 0.5 * (length_a + width_a + length_b + width_b)
    if abs(ds) > reach or abs(dd) > reach:
        return False
    cos_a, sin_a = math.cos(heading_a), math.sin(heading_a)
    cos_b, sin_b = math.cos(heading_b), math.sin(heading_b)
    la, wa, lb, wb = 0.5 * length_a, 0.5 * width_a, 0.5 * length_b, 0.5 * width_b
    return not (
        _separated(ds, dd, cos_a, sin_a, la, wa, cos_b, sin_b, lb, wb)
        or _separated(ds, dd, cos_b, sin_b, lb, wb, cos_a, sin_a, la, wa)
    )

"""What the ego sweeps on its way to a lateral target, and who is in that way."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from algorithms.guard_options import Switches
from envs.compiled import njit
from envs.geometry import PEDESTRIAN_SIZE_M, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M
from envs.motion import ACCELERATION_MAX_MPS2, HORIZON_S, feasible_horizon
from envs.reward import SAFE_HEADWAY_S
from envs.world import FloatArray

LATERAL_MARGIN_M: Final = 0.3
"""Kept on either side of the swept corridor."""
CROSSING_MARGIN_S: Final = 0.3
"""A pedestrian must have left the corridor this long before the ego can arrive."""
TOWARDS_M: Final = 0.01
"""A lateral motion below this leads nowhere."""
STILL_M: Final = 0.1
"""Lateral rate and acceleration that carry the ego less far than this within the horizon are none."""


class Corridor(NamedTuple):
    """What the ego sweeps on its way to a lateral target.

    Attributes:
        low: Right edge [m].
        high: Left edge [m].
        own_low: Right edge of what it covers now [m].
        own_high: Left edge of it [m].
        left: Whether it moves to the left.
        right: Whether it moves to the right.
        speed: Its speed along the road [m/s].
        reach: Distance of centres beyond which no body ahead binds [m].
    """

    low: float
    high: float
    own_low: float
    own_high: float
    left: bool
    right: bool
    speed: float
    reach: float


def lateral_response(samples: int) -> FloatArray:
    """Lateral deviation from the target as time goes on, per unit of what it is now.

    The plan is made anew at every step over its full horizon T, so that the quintic's first jerk,
    -(60 x + 36 v T + 9 a T^2) / T^3, acts as a linear feedback on x, v T and a T^2.

    Returns:
        Factors of x, v T and a T^2 at the times T k / samples, k = 1 to samples; shape (samples, 3).
    """
    system = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-60.0, -36.0, -9.0]])
    values, vectors = np.linalg.eig(system)
    inverse = np.linalg.inv(vectors)
    times = np.arange(1, samples + 1) / samples
    return np.ascontiguousarray(np.real((vectors[0] * np.exp(np.outer(times, values))) @ inverse))


RESPONSE: Final = lateral_response(8)


@njit
def lateral_extent(e: Any, target: float, horizon: float) -> tuple[float, float]:
    """Least and greatest lateral position of the ego's centre on the way to a target [m]."""
    low, high = min(e.d, target), max(e.d, target)
    t = feasible_horizon(target - e.reference_d, horizon)
    x, v, a = e.reference_d - target, e.reference_speed * t, e.reference_acceleration * t * t
    if abs(v) + abs(a) > STILL_M:
        for k in range(RESPONSE.shape[0]):
            d = target + RESPONSE[k, 0] * x + RESPONSE[k, 1] * v + RESPONSE[k, 2] * a
            low, high = min(low, d), max(high, d)
    return low, high


@njit
def reach(speed: float, tc: float) -> float:
    """Distance of centres beyond which a body ahead asks for no less than 3 m/s2, whatever it does [m].

    Derivation: it moves at v_l >= 0, so Eq. (SCA) gives at least 2 (gap - 3.6 v - T_c v) / T_c^2, which is 3 m/s2
    at gap = 3.6 v + T_c v + 1.5 T_c^2. To stop from v + 0.2 m/s takes less than 3.6 v + 3 m up to 13.89 m/s.
    IR shifts a by at most 0.92 m/s2, so such a body is never the binding one where another asks for 2 m/s2.
    """
    return (SAFE_HEADWAY_S + tc) * speed + 1.5 * tc * tc + 3.0 + VEHICLE_LENGTH_M


@njit
def corridor(e: Any, target: float, tc: float, o: Switches) -> Corridor:
    """Corridor of an ego to a lateral target [m], planned within max(T_c, 3 s), with a margin on both sides."""
    low, high = min(e.d, target), max(e.d, target)
    if o.excursion:
        low, high = lateral_extent(e, target, max(tc, HORIZON_S))
    half = own = 0.5 * VEHICLE_WIDTH_M + LATERAL_MARGIN_M
    cosine = math.cos(e.heading)
    if o.turned_body:
        sine = math.sin(e.heading)
        half = 0.5 * (VEHICLE_WIDTH_M * cosine + VEHICLE_LENGTH_M * abs(sine)) + LATERAL_MARGIN_M
    return Corridor(
        low - half, high + half, e.d - own, e.d + own, high > e.d + TOWARDS_M, low < e.d - TOWARDS_M,
        e.speed * cosine, math.inf if o.least_binding else reach(e.speed, tc),
    )  # fmt: skip


@njit
def overlaps(low: float, high: float, d: float, drift: float, width: float) -> bool:
    """Whether a body at d that drifts sideways by `drift` overlaps the strip from low to high [m]."""
    half = 0.5 * width
    return min(d, d + drift) - half < high and max(d, d + drift) + half > low


@njit
def pedestrian_counts(gap: float, d: float, walking: float, low: float, high: float, speed: float) -> bool:
    """Whether a pedestrian ahead will not surely have left the strip when the ego can arrive at the earliest.

    Args:
        gap: Bumper gap ahead, >= 0 [m].
        d: Pedestrian's lateral position [m].
        walking: Signed lateral speed, 0 for one who stands [m/s].
        low: Right edge of the strip swept by the ego [m].
        high: Left edge [m].
        speed: Ego speed [m/s].
    """
    half = 0.5 * PEDESTRIAN_SIZE_M
    if walking == 0.0:
        return d - half < high and d + half > low
    way = (high + half - d) if walking > 0.0 else (d - low + half)
    if way <= 0.0:
        return False
    leaves = way / abs(walking) + CROSSING_MARGIN_S
    b = ACCELERATION_MAX_MPS2
    arrives = (math.sqrt(speed * speed + 2.0 * b * gap) - speed) / b
    return leaves > arrives

"""A guard of Responsibility-Sensitive Safety: proper response to danger, over N worlds.

Source: Shalev-Shwartz, Shammah and Shashua (2017), arXiv:1708.06374, Definitions 7 to 9. Deviations:

- The paper answers in the dimension that was safe before the danger began. The guard keeps no memory: it answers
  sideways where the ego can still come to rest before it touches, else by braking. One safe distance with the
  response time in it was kept a step ago, so that one of the two always suffices.
- Against a body that comes closer sideways by itself the ego brakes, too: traffic does not answer to RSS.
- A pedestrian keeps his speed and answers to nothing: he is in danger while he may be in the ego's way when it
  arrives (`algorithms.corridor.pedestrian_counts`). The ego always brakes for him, also where it answers sideways:
  alternating between the two answers let it use up its stopping distance (3 in 10,000 episodes of full throttle).
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from algorithms.corridor import LATERAL_MARGIN_M, lateral_extent, overlaps, pedestrian_counts
from algorithms.method import Observations
from algorithms.rss import gap_needed_ahead, gap_needed_behind, gap_needed_beside
from envs.compiled import njit, njit_inlined
from envs.geometry import PEDESTRIAN_SIZE_M, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M
from envs.motion import ACCELERATION_MIN_MPS2, HORIZON_S
from envs.world import CROSSING, BoolArray, FloatArray, Records, World

REST_HORIZON_S: Final = 1.5
"""Planning horizon of the lateral answer: the ego comes to rest sideways."""
UNDERSHOOT: Final = 1.03
"""The lateral answer's greatest excursion over its final one (damping 0.75)."""
WALK_S: Final = 1.0
"""How far ahead a pedestrian beside the ego is foreseen."""
SAME: Final = 1e-9


@njit
def rest_distance(speed: float, acceleration: float) -> float:
    """Way until the ego is at rest sideways, once its target is where it is at every step [m].

    Derivation: the quintic's first jerk is then -(36 v T + 9 a T^2) / T^3, so v'' + (9 / T) v' + (36 / T^2) v = 0,
    whose integral from (v, a) is v T / 4 + a T^2 / 36: the same place at every moment on the way. A motion that turns
    about before leads up to 0.05 m beyond it; mu and the corridor's margin hold that.

    Args:
        speed: Lateral [m/s].
        acceleration: Lateral [m/s2].
    """
    t = REST_HORIZON_S
    return UNDERSHOOT * max(0.25 * speed * t + acceleration * t * t / 36.0, 0.0)


@njit
def extents(heading: float) -> tuple[float, float]:
    """Half length along and half width across the road of a turned car [m]."""
    cosine, sine = abs(math.cos(heading)), abs(math.sin(heading))
    return (
        0.5 * (VEHICLE_LENGTH_M * cosine + VEHICLE_WIDTH_M * sine),
        0.5 * (VEHICLE_WIDTH_M * cosine + VEHICLE_LENGTH_M * sine),
    )


@njit_inlined
def _answer_to_vehicle(e: Any, v: Any, half_s: float, half_d: float) -> tuple[bool, float]:
    """Whether the ego must brake, and to which side it must not move: 1 left, -1 right, 0 neither."""
    if v.present == 0:
        return False, 0.0
    ds, dd = v.s - e.s, v.d - e.d
    other_half_s, other_half_d = extents(v.heading)
    gap = abs(ds) - half_s - other_half_s
    speed, other = e.speed * math.cos(e.heading), v.speed * math.cos(v.heading)
    if gap >= (gap_needed_ahead(speed, other) if ds > 0.0 else gap_needed_behind(speed, other)):
        return False, 0.0
    side = 1.0 if dd > 0.0 else -1.0
    beside = abs(dd) - half_d - other_half_d
    own, towards = side * e.reference_speed, -side * v.speed * math.sin(v.heading)
    if beside >= gap_needed_beside(own, towards):
        return False, 0.0
    can_rest = towards <= 0.0 and beside > rest_distance(own, side * e.reference_acceleration)
    return ds > 0.0 and not can_rest, side if can_rest or gap <= 0.0 else 0.0


@njit_inlined
def _endangers(e: Any, p: Any, low: float, high: float, half_s: float) -> bool:
    """Whether the ego, in the strip from low to high, endangers a pedestrian ahead or beside it."""
    ds = p.s - e.s
    gap = abs(ds) - half_s - 0.5 * PEDESTRIAN_SIZE_M
    if p.state != CROSSING or (ds < 0.0 and gap > 0.0):
        return False
    if gap <= 0.0:
        return overlaps(low, high, p.d, p.lateral_speed * WALK_S, PEDESTRIAN_SIZE_M)
    if gap >= gap_needed_ahead(e.speed, 0.0):
        return False
    return pedestrian_counts(gap, p.d, p.lateral_speed, low, high, e.speed)


@njit
def _rest_or_away(e: Any, target: float, left: bool, right: bool) -> tuple[float, float]:
    """Target and horizon that do not lead to a forbidden side: come to rest, or move away."""
    here = e.reference_d
    if (left and e.reference_speed > 0.0) or (right and e.reference_speed < 0.0):
        return here, REST_HORIZON_S
    if left:
        target = min(target, here)
    if right:
        target = max(target, here)
    return target, HORIZON_S


@njit
def _answer_to_pedestrians(
    e: Any, pedestrians: Records, i: int, target: float, horizon: float, half_s: float, half_d: float
) -> tuple[bool, bool]:
    """Whether the ego must brake, and whether it must not go on sideways to the target."""
    half = half_d + LATERAL_MARGIN_M
    low, high = lateral_extent(e, target, horizon)
    rest_low = e.d - rest_distance(-e.reference_speed, -e.reference_acceleration)
    rest_high = e.d + rest_distance(e.reference_speed, e.reference_acceleration)
    brake, rest = False, False
    for j in range(pedestrians.shape[1]):
        p = pedestrians[i, j]
        if _endangers(e, p, rest_low - half, rest_high + half, half_s):
            brake = True
        elif _endangers(e, p, low - half, high + half, half_s):
            # At rest sideways the ego seems clear of him. It brakes, too: what it does later must not rest on that.
            brake = rest = True
    return brake, rest


@njit
def rss_kernel(
    ego: Records, vehicles: Records, pedestrians: Records, targets: FloatArray, accelerations: FloatArray,
    out: FloatArray, intervened: BoolArray,
) -> None:  # fmt: skip
    """Proper response in every world; the last two arrays are written. Rows of out (3, N): target, a, horizon."""
    for i in range(ego.shape[0]):
        e = ego[i]
        half_s, half_d = extents(e.heading)
        brake, left, right = False, False, False
        for j in range(vehicles.shape[1]):
            stop, side = _answer_to_vehicle(e, vehicles[i, j], half_s, half_d)
            brake, left, right = brake or stop, left or side > 0.0, right or side < 0.0
        target, horizon = targets[i], HORIZON_S
        if left or right:
            target, horizon = _rest_or_away(e, target, left, right)
        stop, rest = _answer_to_pedestrians(e, pedestrians, i, target, horizon, half_s, half_d)
        if rest:
            target, horizon = e.reference_d, REST_HORIZON_S
        command = min(accelerations[i], ACCELERATION_MIN_MPS2) if brake or stop else accelerations[i]
        out[0, i], out[1, i], out[2, i] = target, command, horizon
        intervened[i] = command != accelerations[i] or abs(target - targets[i]) > SAME or horizon != HORIZON_S


class RSSGuard:
    """Responsibility-Sensitive Safety: a `Shield` that keeps nothing from one step to the next."""

    def begin(self, seed: np.random.SeedSequence) -> None:
        """Draws no numbers."""

    def observe(self, observations: Observations) -> None:
        """Needs no observations."""

    def filter(
        self, world: World, targets: FloatArray, accelerations: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray]:
        """See `envs.world.Shield.filter`."""
        out, intervened = np.empty((3, len(world))), np.empty(len(world), np.bool_)
        rss_kernel(world.ego, world.vehicles, world.pedestrians, targets, accelerations, out, intervened)
        return out[0], out[1], intervened, out[2]

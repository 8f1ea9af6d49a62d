"""The safety guard, Alg. 2: lateral check, then longitudinal limits, over N worlds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from algorithms.critical_acceleration import follower_can_brake, sca, stopping_bound
from algorithms.method import Observations
from envs.compiled import njit
from envs.geometry import (
    PEDESTRIAN_SIZE_M,
    VEHICLE_LENGTH_M,
    VEHICLE_WIDTH_M,
    bumper_gap,
    lane_centre,
    nearest_lane,
)
from envs.motion import ACCELERATION_MAX_MPS2, ACCELERATION_MIN_MPS2, HORIZON_S
from envs.reward import SAFE_HEADWAY_S
from envs.world import CROSSING, BoolArray, FloatArray, Records, World

LATERAL_MARGIN_M: Final = 0.3
"""Kept on either side of the swept corridor."""
CROSSING_MARGIN_S: Final = 0.3
"""A pedestrian must have left the corridor this long before the ego can arrive."""
K2: Final = 0.92
B2: Final = 0.02
"""Linear(IR) = k2 IR + b2 (paper, appendix)."""
SAME_TARGET_M: Final = 1e-9


@dataclass(frozen=True, slots=True)
class GuardOptions:
    """Readings of Alg. 2 that can be switched; the defaults are those of docs/fidelity.md.

    Attributes:
        literal_all_lanes: Every object counts, whatever its lane.
        literal_followers: Followers in the ego's own lane count, too.
        literal_selection: The printed max over preceding objects, which picks the least binding one.
        literal_longitudinal: The printed a_x = a_pre also where a_x was too low.
        reserve: Correction: limits also keep a braking reserve (`stopping_bound`, `follower_can_brake`).
    """

    literal_all_lanes: bool = False
    literal_followers: bool = False
    literal_selection: bool = False
    literal_longitudinal: bool = False
    reserve: bool = True


@njit
def _overlaps(low: float, high: float, d: float, drift: float, width: float) -> bool:
    """Whether a body at d that drifts sideways by `drift` overlaps the strip from low to high [m]."""
    half = 0.5 * width
    return min(d, d + drift) - half < high and max(d, d + drift) + half > low


@njit
def pedestrian_counts(
    gap: float, d: float, walking: float, low: float, high: float, speed: float
) -> bool:
    """Whether a pedestrian ahead will not surely have left the strip when the ego can arrive at the earliest.

    Args:
        gap: Bumper gap ahead, > 0 [m].
        d: Pedestrian's lateral position [m].
        walking: Signed lateral speed [m/s].
        low: Right edge of the strip swept by the ego [m].
        high: Left edge [m].
        speed: Ego speed [m/s].
    """
    half = 0.5 * PEDESTRIAN_SIZE_M
    way = (high + half - d) if walking > 0.0 else (d - low + half)
    if way <= 0.0:
        return False
    leaves = way / max(abs(walking), 1e-6) + CROSSING_MARGIN_S
    b = ACCELERATION_MAX_MPS2
    arrives = (math.sqrt(speed * speed + 2.0 * b * gap) - speed) / b
    return leaves > arrives


@njit
def _limits(
    ego: Records, vehicles: Records, pedestrians: Records, i: int, target: float, horizon: float,
    importance: FloatArray, all_lanes: bool, followers: bool, pick_max: bool, reserve: bool,
) -> tuple[float, float]:  # fmt: skip
    """Safe critical accelerations (a_pre, a_follow) of the corridor to a target; +inf and -inf where it is empty."""
    e = ego[i]
    speed = e.speed * math.cos(e.heading)
    safe = SAFE_HEADWAY_S * speed
    half = 0.5 * VEHICLE_WIDTH_M + LATERAL_MARGIN_M
    low, high = min(e.d, target) - half, max(e.d, target) + half
    pre, pre_key = math.inf, -math.inf if pick_max else math.inf
    follow, follow_key = -math.inf, -math.inf
    for j in range(vehicles.shape[1]):
        v = vehicles[i, j]
        if v.present == 0:
            continue
        drift = v.speed * math.sin(v.heading) * HORIZON_S
        if not (all_lanes or _overlaps(low, high, v.d, drift, VEHICLE_WIDTH_M)):
            continue
        ds = v.s - e.s
        other = v.speed * math.cos(v.heading)
        gap = bumper_gap(ds, VEHICLE_LENGTH_M)
        weight = K2 * importance[i, j] + B2
        if gap <= 0.0 or ds > 0.0:
            # A body in the same lane that has been passed cannot be run into: only one alongside can.
            if gap <= 0.0 and ds < 0.0 and _overlaps(e.d - half, e.d + half, v.d, 0.0, VEHICLE_WIDTH_M):
                continue
            a = -math.inf if gap <= 0.0 else sca(gap, safe, other - speed, horizon)
            if reserve and gap > 0.0:
                a = min(a, stopping_bound(gap, speed, other))
            key = a + weight if pick_max else a - weight
            if (key > pre_key) if pick_max else (key < pre_key or a == -math.inf):
                pre, pre_key = a, key
        else:
            own = _overlaps(e.d - half, e.d + half, v.d, 0.0, VEHICLE_WIDTH_M)
            if own and not followers:
                continue
            a = sca(-gap, safe, other - speed, horizon)
            if reserve and not own and not follower_can_brake(gap, speed, other):
                a = math.inf
            if a + weight > follow_key:
                follow, follow_key = a, a + weight
    for j in range(pedestrians.shape[1]):
        p = pedestrians[i, j]
        if p.state != CROSSING or p.s <= e.s:
            continue
        gap = bumper_gap(p.s - e.s, PEDESTRIAN_SIZE_M)
        if not all_lanes and not pedestrian_counts(max(gap, 0.0), p.d, p.lateral_speed, low, high, speed):
            continue
        a = -math.inf if gap <= 0.0 else sca(gap, safe, -speed, horizon)
        if reserve and gap > 0.0:
            a = min(a, stopping_bound(gap, speed, 0.0))
        weight = K2 * importance[i, vehicles.shape[1] + j] + B2
        key = a + weight if pick_max else a - weight
        if (key > pre_key) if pick_max else (key < pre_key or a == -math.inf):
            pre, pre_key = a, key
    return pre, follow


@njit
def guard_kernel(
    ego: Records, vehicles: Records, pedestrians: Records, targets: FloatArray, accelerations: FloatArray,
    horizons: FloatArray, importance: FloatArray, all_lanes: bool, followers: bool, pick_max: bool,
    literal_longitudinal: bool, reserve: bool,
    safe_targets: FloatArray, safe_accelerations: FloatArray, intervened: BoolArray, limits: FloatArray,
) -> None:  # fmt: skip
    """Alg. 2 for every world; the last four arrays are written, limits (N, 2) with a_pre and a_follow."""
    for i in range(ego.shape[0]):
        target, command, flagged = targets[i], accelerations[i], False
        pre, follow = _limits(
            ego, vehicles, pedestrians, i, target, horizons[i], importance, all_lanes, followers, pick_max, reserve
        )
        if pre < follow or pre < ACCELERATION_MIN_MPS2 or follow > ACCELERATION_MAX_MPS2:
            flagged = True
            centre = lane_centre(nearest_lane(ego[i].d))
            if abs(centre - target) > SAME_TARGET_M:
                target = centre
                pre, follow = _limits(
                    ego, vehicles, pedestrians, i, target, horizons[i], importance,
                    all_lanes, followers, pick_max, reserve,
                )  # fmt: skip
        if not follow <= command <= pre:
            flagged = True
            command = pre if literal_longitudinal else min(max(command, follow), pre)
        safe_targets[i] = target
        safe_accelerations[i] = min(max(command, ACCELERATION_MIN_MPS2), ACCELERATION_MAX_MPS2)
        intervened[i] = flagged
        limits[i, 0], limits[i, 1] = pre, follow


def require_horizon(tc: float) -> float:
    """T_c as a number, or an error that names it.

    Raises:
        ValueError: T_c is not positive or not finite.
    """
    if not (math.isfinite(tc) and tc > 0.0):
        raise ValueError(f"T_c = {tc} s: must be positive and finite.")
    return float(tc)


class SafetyGuard:
    """Alg. 2 with a fixed T_c: a `Shield`.

    Attributes:
        tc: Adjustment time of each world, shape (N,) [s], or the fixed value.
        limits: a_pre and a_follow of the last call, shape (N, 2) [m/s2].
    """

    def __init__(self, tc: float = 3.0, options: GuardOptions | None = None) -> None:
        """Fix T_c [s], > 0."""
        self.tc = require_horizon(tc)
        self.options = options or GuardOptions()
        self.limits = np.zeros((0, 2))

    def begin(self, seed: np.random.SeedSequence) -> None:
        """A fixed guard draws no numbers."""

    def observe(self, observations: Observations) -> None:
        """A fixed guard needs no observations."""

    def horizons(self, world: World) -> FloatArray:
        """T_c of every world, (N,) [s]."""
        return np.full(len(world), self.tc)

    def importance(self, world: World) -> FloatArray:
        """IR of every vehicle, then every pedestrian, (N, V + P) in [0, 1]; a fixed guard ranks nobody."""
        return np.zeros((len(world), world.vehicles.shape[1] + world.pedestrians.shape[1]))

    def filter(
        self, world: World, targets: FloatArray, accelerations: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray]:
        """See `envs.world.Shield.filter`; the planner's horizon is max(T_c, 3 s)."""
        n = len(world)
        horizons = self.horizons(world)
        safe_targets, safe_accelerations = np.empty(n), np.empty(n)
        intervened = np.empty(n, np.bool_)
        self.limits = np.empty((n, 2))
        o = self.options
        guard_kernel(
            world.ego, world.vehicles, world.pedestrians, targets, accelerations, horizons,
            self.importance(world), o.literal_all_lanes, o.literal_followers, o.literal_selection,
            o.literal_longitudinal, o.reserve, safe_targets, safe_accelerations, intervened, self.limits,
        )  # fmt: skip
        return safe_targets, safe_accelerations, intervened, np.maximum(horizons, HORIZON_S)

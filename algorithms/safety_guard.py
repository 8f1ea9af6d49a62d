"""The safety guard, Alg. 2: lateral check, then longitudinal limits, over N worlds."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, TypeVar, cast

import numba
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
from envs.motion import ACCELERATION_MAX_MPS2, ACCELERATION_MIN_MPS2, HORIZON_S, feasible_horizon
from envs.reward import SAFE_HEADWAY_S
from envs.world import CROSSING, BoolArray, FloatArray, Records, World

F = TypeVar("F", bound=Callable[..., Any])

GUARD_VERSION: Final = 3
"""Raised by every change that alters what the guard does; also the version of the methods behind it."""
LATERAL_MARGIN_M: Final = 0.3
"""Kept on either side of the swept corridor."""
CROSSING_MARGIN_S: Final = 0.3
"""A pedestrian must have left the corridor this long before the ego can arrive."""
K2: Final = 0.92
B2: Final = 0.02
"""Linear(IR) = k2 IR + b2 (paper, appendix)."""
SAME_TARGET_M: Final = 1e-9
TOWARDS_M: Final = 0.01
"""A lateral motion below this leads nowhere."""
STILL_M: Final = 0.1
"""Lateral rate and acceleration that carry the ego less far than this within the horizon are none."""


def _inlined(function: F) -> F:
    """`envs.compiled.njit`, always compiled into its caller: handing over records and arrays costs 0.1 us a call."""
    compiled: Any = numba.njit(cache=True, error_model="numpy", forceinline=True)(function)
    return cast(F, compiled)


@dataclass(frozen=True, slots=True)
class GuardOptions:
    """Readings of Alg. 2 that can be switched; the defaults are those of docs/fidelity.md.

    Attributes:
        literal_all_lanes: Every object counts, whatever its lane.
        literal_followers: Followers in the ego's own lane count, too.
        literal_selection: The printed max over preceding objects, which picks the least binding one.
        literal_longitudinal: The printed a_x = a_pre also where a_x was too low.
        reserve: Correction: limits also keep a braking reserve (`stopping_bound`, `follower_can_brake`).
        hold: Correction: where the way to the lane's centre is blocked, too, the last executed target stays.
        turned_body: Correction: the corridor holds the turned body, whose corners stand out.
        excursion: Correction: the corridor holds the way that the present lateral motion leads before it ends.
    """

    literal_all_lanes: bool = False
    literal_followers: bool = False
    literal_selection: bool = False
    literal_longitudinal: bool = False
    reserve: bool = True
    hold: bool = True
    turned_body: bool = True
    excursion: bool = True


class Switches(NamedTuple):
    """`GuardOptions` as compiled code takes them, in the same order."""

    all_lanes: bool
    followers: bool
    least_binding: bool
    printed_longitudinal: bool
    reserve: bool
    hold: bool
    turned_body: bool
    excursion: bool


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
def _overlaps(low: float, high: float, d: float, drift: float, width: float) -> bool:
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


@_inlined
def _vehicle_limits(e: Any, v: Any, c: Corridor, tc: float, o: Switches) -> tuple[float, float, float]:
    """SCA of a car as preceding and as following object, and its stopping bound; inf, -inf, inf if it is none."""
    ds = v.s - e.s
    if v.present == 0 or ds > c.reach:
        return math.inf, -math.inf, math.inf
    drift, other = 0.0, v.speed
    if v.heading != 0.0:
        drift, other = v.speed * math.sin(v.heading) * HORIZON_S, v.speed * math.cos(v.heading)
    if not (o.all_lanes or _overlaps(c.low, c.high, v.d, drift, VEHICLE_WIDTH_M)):
        return math.inf, -math.inf, math.inf
    gap = bumper_gap(ds, VEHICLE_LENGTH_M)
    if gap <= 0.0:
        # By driving on, nobody runs into a body beside his rear half: only by moving towards it.
        towards = c.left if v.d > e.d else c.right
        return (math.inf if ds < 0.0 and not (towards or o.all_lanes) else -math.inf), -math.inf, math.inf
    safe = SAFE_HEADWAY_S * c.speed
    if ds > 0.0:
        bound = stopping_bound(gap, e.speed, other) if o.reserve else math.inf
        return sca(gap, safe, other - c.speed, tc), -math.inf, bound
    own = _overlaps(c.own_low, c.own_high, v.d, 0.0, VEHICLE_WIDTH_M)
    if own and not o.followers:
        return math.inf, -math.inf, math.inf
    if o.reserve and not own and not follower_can_brake(gap, c.speed, other):
        return math.inf, math.inf, math.inf
    return math.inf, sca(-gap, safe, other - c.speed, tc), math.inf


@_inlined
def _pedestrian_limits(e: Any, p: Any, c: Corridor, tc: float, o: Switches) -> tuple[float, float]:
    """SCA and stopping bound of a pedestrian ahead or alongside; inf where he is none."""
    ds = p.s - e.s
    gap = bumper_gap(ds, PEDESTRIAN_SIZE_M)
    if p.state != CROSSING or ds > c.reach or (ds <= 0.0 and gap > 0.0):
        return math.inf, math.inf
    if not o.all_lanes and not pedestrian_counts(max(gap, 0.0), p.d, p.lateral_speed, c.low, c.high, e.speed):
        return math.inf, math.inf
    if gap <= 0.0:
        towards = c.left if p.d > e.d else c.right
        return (math.inf if ds <= 0.0 and not towards else -math.inf), math.inf
    bound = stopping_bound(gap, e.speed, 0.0) if o.reserve else math.inf
    return sca(gap, SAFE_HEADWAY_S * c.speed, -c.speed, tc), bound


@_inlined
def _limits(
    ego: Records, vehicles: Records, pedestrians: Records, i: int, target: float, tc: float,
    importance: FloatArray, o: Switches,
) -> tuple[float, float]:  # fmt: skip
    """Safe critical accelerations (a_pre, a_follow) on the way to a target; inf and -inf where it is empty."""
    e = ego[i]
    c = corridor(e, target, tc, o)
    sign = -1.0 if o.least_binding else 1.0
    pre, pre_key, reserve = math.inf, math.inf, math.inf
    follow, follow_key = -math.inf, -math.inf
    count = vehicles.shape[1]
    for j in range(count):
        a, back, bound = _vehicle_limits(e, vehicles[i, j], c, tc, o)
        reserve = min(reserve, bound)
        weight = K2 * importance[i, j] + B2
        # The binding object has the least a - Linear(IR); the paper prints the greatest a + Linear(IR).
        if a < math.inf and sign * a - weight < pre_key:
            pre, pre_key = a, sign * a - weight
        if back + weight > follow_key:
            follow, follow_key = back, back + weight
    for j in range(pedestrians.shape[1]):
        a, bound = _pedestrian_limits(e, pedestrians[i, j], c, tc, o)
        reserve = min(reserve, bound)
        weight = K2 * importance[i, count + j] + B2
        if a < math.inf and sign * a - weight < pre_key:
            pre, pre_key = a, sign * a - weight
    return min(pre, reserve), follow


@njit
def _conflict(pre: float, follow: float) -> bool:
    """Whether no acceleration that the ego has keeps both limits."""
    return pre < follow or pre < ACCELERATION_MIN_MPS2 or follow > ACCELERATION_MAX_MPS2


@njit
def guard_kernel(
    ego: Records, vehicles: Records, pedestrians: Records, targets: FloatArray, accelerations: FloatArray,
    horizons: FloatArray, importance: FloatArray, o: Switches, out: FloatArray, intervened: BoolArray,
) -> int:  # fmt: skip
    """Alg. 2 for every world; the last two arrays are written.

    Rows of out (5, N): target, acceleration, planning horizon, a_pre, a_follow.

    Returns:
        -1, or the first world whose T_c is not positive and finite.
    """
    for i in range(ego.shape[0]):
        if not 0.0 < horizons[i] < math.inf:
            return i
        target, pre, follow, flagged = targets[i], -math.inf, math.inf, False
        candidate = target
        # The proposed target; else the lane's centre, d_fn = 0; else what was executed before.
        for attempt in range(3 if o.hold else 2):
            if attempt > 0:
                flagged = True
                candidate = lane_centre(nearest_lane(ego[i].d)) if attempt == 1 else ego[i].target_d
                if abs(candidate - target) <= SAME_TARGET_M:
                    continue
            a, b = _limits(ego, vehicles, pedestrians, i, candidate, horizons[i], importance, o)
            free = not _conflict(a, b)
            if free or attempt < 2 or a > pre or a == pre > -math.inf:
                target, pre, follow = candidate, a, b
            if free:
                break
        command = accelerations[i]
        if not follow <= command <= pre:
            flagged = True
            command = pre if o.printed_longitudinal else min(max(command, follow), pre)
        out[0, i] = target
        out[1, i] = min(max(command, ACCELERATION_MIN_MPS2), ACCELERATION_MAX_MPS2)
        out[2, i] = max(horizons[i], HORIZON_S)
        out[3, i], out[4, i] = pre, follow
        intervened[i] = flagged
    return -1


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
        tc: The fixed T_c [s].
        options: Readings of Alg. 2.
        limits: a_pre and a_follow of the last call, shape (N, 2) [m/s2].
    """

    def __init__(self, tc: float = 3.0, options: GuardOptions | None = None) -> None:
        """Fix T_c [s], > 0."""
        self.tc = require_horizon(tc)
        self.options = options or GuardOptions()
        self.limits = np.zeros((0, 2))
        self._fixed_horizons = np.zeros(0)
        self._no_importance = np.zeros((0, 0))
        self._switches = Switches(*dataclasses.astuple(self.options))

    def begin(self, seed: np.random.SeedSequence) -> None:
        """A fixed guard draws no numbers."""

    def observe(self, observations: Observations) -> None:
        """A fixed guard needs no observations."""

    def horizons(self, world: World) -> FloatArray:
        """T_c of every world, (N,) [s]."""
        if len(self._fixed_horizons) != len(world):
            self._fixed_horizons = np.full(len(world), self.tc)
        return self._fixed_horizons

    def importance(self, world: World) -> FloatArray:
        """IR of every vehicle, then every pedestrian, (N, V + P) in [0, 1]; a fixed guard ranks nobody."""
        shape = (len(world), world.vehicles.shape[1] + world.pedestrians.shape[1])
        if self._no_importance.shape != shape:
            self._no_importance = np.zeros(shape)
        return self._no_importance

    def filter(
        self, world: World, targets: FloatArray, accelerations: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray]:
        """See `envs.world.Shield.filter`; the planner's horizon is max(T_c, 3 s).

        Raises:
            ValueError: A T_c is not positive or not finite.
        """
        n, horizons = len(world), self.horizons(world)
        out, intervened = np.empty((5, n)), np.empty(n, np.bool_)
        bad = guard_kernel(
            world.ego, world.vehicles, world.pedestrians, targets, accelerations, horizons,
            self.importance(world), self._switches, out, intervened,
        )  # fmt: skip
        if bad >= 0:
            raise ValueError(f"T_c = {horizons[bad]} s in world {bad}: must be positive and finite.")
        self.limits = out[3:].T
        return out[0], out[1], intervened, out[2]

"""The safety guard, Alg. 2: lateral check, then longitudinal limits, over N worlds."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Final

import numpy as np

from algorithms.corridor import Corridor, corridor, overlaps, pedestrian_counts
from algorithms.critical_acceleration import follower_can_brake, sca, stopping_bound
from algorithms.guard_demand import Demand, require_demand, require_horizon, require_share
from algorithms.guard_options import GuardOptions, Switches
from algorithms.method import Observations
from envs.compiled import borrowed, njit, njit_inlined
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
from envs.scenario import PEDESTRIAN_SLOTS, VEHICLE_SLOTS
from envs.world import CROSSING, BoolArray, FloatArray, Records, World

K2: Final = 0.92
B2: Final = 0.02
"""Linear(IR) = k2 IR + b2 (paper, appendix)."""
SAME_TARGET_M: Final = 1e-9


@njit_inlined
def _vehicle_limits(e: Any, v: Any, c: Corridor, tc: float, share: float, o: Switches) -> tuple[float, float, float]:
    """SCA of a car as preceding and as following object, and its stopping bound; inf, -inf, inf if it is none."""
    ds = v.s - e.s
    if v.present == 0 or ds > c.reach:
        return math.inf, -math.inf, math.inf
    drift, other = 0.0, v.speed
    if v.heading != 0.0:
        drift, other = v.speed * math.sin(v.heading) * HORIZON_S, v.speed * math.cos(v.heading)
    if not (o.all_lanes or overlaps(c.low, c.high, v.d, drift, VEHICLE_WIDTH_M)):
        return math.inf, -math.inf, math.inf
    gap = bumper_gap(ds, VEHICLE_LENGTH_M)
    if gap <= 0.0:
        # By driving on, nobody runs into a body beside his rear half: only by moving towards it.
        towards = c.left if v.d > e.d else c.right
        return (math.inf if ds < 0.0 and not (towards or o.all_lanes) else -math.inf), -math.inf, math.inf
    safe = share * SAFE_HEADWAY_S * c.speed
    if ds > 0.0:
        bound = stopping_bound(gap, e.speed, other) if o.reserve else math.inf
        return sca(gap, safe, other - c.speed, tc), -math.inf, bound
    own = overlaps(c.own_low, c.own_high, v.d, 0.0, VEHICLE_WIDTH_M)
    if own and not o.followers:
        return math.inf, -math.inf, math.inf
    if o.reserve and not own and not follower_can_brake(gap, c.speed, other):
        return math.inf, math.inf, math.inf
    return math.inf, sca(-gap, safe, other - c.speed, tc), math.inf


@njit_inlined
def _pedestrian_limits(e: Any, p: Any, c: Corridor, tc: float, share: float, o: Switches) -> tuple[float, float]:
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
    return sca(gap, share * SAFE_HEADWAY_S * c.speed, -c.speed, tc), bound


@njit_inlined
def limits_to(
    ego: Records, vehicles: Records, pedestrians: Records, i: int, target: float, tc: float, share: float,
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
        a, back, bound = _vehicle_limits(e, vehicles[i, j], c, tc, share, o)
        reserve = min(reserve, bound)
        weight = K2 * importance[i, j] + B2
        # The binding object has the least a - Linear(IR); the paper prints the greatest a + Linear(IR).
        if a < math.inf and sign * a - weight < pre_key:
            pre, pre_key = a, sign * a - weight
        if back + weight > follow_key:
            follow, follow_key = back, back + weight
    for j in range(pedestrians.shape[1]):
        a, bound = _pedestrian_limits(e, pedestrians[i, j], c, tc, share, o)
        reserve = min(reserve, bound)
        weight = K2 * importance[i, count + j] + B2
        if a < math.inf and sign * a - weight < pre_key:
            pre, pre_key = a, sign * a - weight
    return min(pre, reserve), follow


@njit
def _conflict(pre: float, follow: float) -> bool:
    """Whether no acceleration that the ego has keeps both limits."""
    return pre < follow or pre < ACCELERATION_MIN_MPS2 or follow > ACCELERATION_MAX_MPS2


@njit_inlined
def _usable(horizon: float, share: float, importance: FloatArray, i: int) -> bool:
    """Whether what is asked for in world i can be met: NaN would lose every comparison and so switch it off."""
    usable = 0.0 < horizon < math.inf and 0.0 <= share <= 1.0
    for j in range(importance.shape[1]):
        usable &= math.isfinite(importance[i, j])
    return usable


@njit
def guard_kernel(
    ego: Records, vehicles: Records, pedestrians: Records, targets: FloatArray, accelerations: FloatArray,
    horizons: FloatArray, shares: FloatArray, importance: FloatArray, o: Switches, out: FloatArray,
    intervened: BoolArray,
) -> int:  # fmt: skip
    """Alg. 2 for every world; the last two arrays are written.

    shares (N,) in [0, 1]: the part of S_safe that is demanded; 1 in the paper.
    Rows of out (5, N): target, acceleration, planning horizon, a_pre, a_follow.

    Returns:
        -1, or the first world whose T_c is not positive and finite, whose share is not within 0 and 1, or of which
        an importance is not finite.
    """
    ego, vehicles, pedestrians, importance = (
        borrowed(ego),
        borrowed(vehicles),
        borrowed(pedestrians),
        borrowed(importance),
    )
    for i in range(ego.shape[0]):
        if not _usable(horizons[i], shares[i], importance, i):
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
            a, b = limits_to(ego, vehicles, pedestrians, i, candidate, horizons[i], shares[i], importance, o)
            free = not _conflict(a, b)
            # A tie keeps what was executed; not if that leads to a follower that cannot brake, b = inf.
            kept = a == pre > -math.inf and not (o.give_way and b == math.inf)
            if free or attempt < 2 or a > pre or kept:
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


class SafetyGuard:
    """Alg. 2 with a fixed T_c: a `Shield`.

    Attributes:
        tc: The fixed T_c [s].
        share: The part of S_safe that is demanded, in [0, 1]; what `reserve` keeps is kept at any share.
        options: Readings of Alg. 2.
        switches: The same for compiled code.
        limits: a_pre and a_follow of the last call, shape (N, 2) [m/s2].
    """

    def __init__(self, tc: float = 3.0, options: GuardOptions | None = None, share: float = 1.0) -> None:
        """Fix T_c [s], > 0, and the demanded share of S_safe."""
        self.tc = require_horizon(tc)
        self.share = require_share(share)
        self.options = options or GuardOptions()
        self.limits = np.zeros((0, 2))
        self._fixed_horizons, self._fixed_shares = np.zeros((2, 0))
        self._no_importance = np.zeros((0, 0))
        self.switches = Switches(*dataclasses.astuple(self.options))

    def begin(self, seed: np.random.SeedSequence) -> None:
        """A fixed guard draws no numbers."""

    def observe(self, observations: Observations) -> None:
        """A fixed guard needs no observations."""

    def demand(self, observations: Observations) -> Demand:
        """What it will ask for from the decision at these observations, (N, 47), on."""
        n = len(observations)
        slots = np.zeros((n, VEHICLE_SLOTS + PEDESTRIAN_SLOTS))
        return Demand(np.full(n, self.tc), np.full(n, self.share), slots)

    def horizons(self, world: World) -> FloatArray:
        """T_c of every world, (N,) [s]."""
        if len(self._fixed_horizons) != len(world):
            self._fixed_horizons = np.full(len(world), self.tc)
        return self._fixed_horizons

    def shares(self, world: World) -> FloatArray:
        """Demanded part of S_safe in every world, (N,) in [0, 1]."""
        if len(self._fixed_shares) != len(world):
            self._fixed_shares = np.full(len(world), self.share)
        return self._fixed_shares

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
            ValueError: A T_c is not positive or not finite, a share not within 0 and 1, or an importance not finite;
                or there is not one for each world and body.
        """
        n, bodies = len(world), world.vehicles.shape[1] + world.pedestrians.shape[1]
        horizons, shares, importance = self.horizons(world), self.shares(world), self.importance(world)
        if not (horizons.shape == shares.shape == (n,) and importance.shape == (n, bodies)):
            raise ValueError(
                f"{type(self).__name__} has T_c, share and importance of shapes {horizons.shape}, {shares.shape}, "
                f"{importance.shape}; {n} worlds of {bodies} bodies need ({n},), ({n},), ({n}, {bodies}): "
                "call observe() with the observations of these worlds first."
            )
        out, intervened = np.empty((5, n)), np.empty(n, np.bool_)
        bad = guard_kernel(
            world.ego, world.vehicles, world.pedestrians, targets, accelerations, horizons, shares, importance,
            self.switches, out, intervened,
        )  # fmt: skip
        if bad >= 0:
            require_demand(float(horizons[bad]), float(shares[bad]), importance[bad], f" in world {bad}")
        self.limits = out[3:].T
        return out[0], out[1], intervened, out[2]

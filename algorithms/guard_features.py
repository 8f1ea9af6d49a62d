"""What the guard would allow, shown to the policy: an observation augmented by the guard's present limits.

A guard flags what it did not expect the policy to know: where its limits lie. They follow from the state of Table I,
so that no information is added; the policy is spared learning Alg. 2 from its penalties. Behind each observation stand,
for the lane to the right, the own one and the one to the left, a_pre and a_follow of Alg. 2 on the way to its centre:

| entries | content |
|---|---|
| 47 + 2 k | a_pre to lane k - 1 from the ego's, k = 0..2 |
| 48 + 2 k | a_follow on the same way |

Scale: sign(a) ln(1 + abs(a)) / ln(41), clipped to [-1, 1]. A decision holds for 0.5 s, in which limits tighten. The
braking reserve is a limit for 0.1 s: 20 m/s2 there is 2 m/s of speed to spare, so that limits far beyond the ego's
2 m/s2 matter.

A feature jumps where a body comes within the guard's `reach`, beyond which it asks for no less than 3 m/s2 and the
guard leaves it out (inf, feature 1). A standing one asks for 3 + 6 / T_c^2 there, with all of S_safe: the feature falls
from 1 to 0.62 at T_c 1 s, to 0.41 at 3 s and to 0.38 at 7 s. One that drives, and a smaller share, asks for more, and
the step is smaller. No action is affected, as the ego has 2 m/s2.

A lane that does not exist allows nothing: -1 and 1. The planner's state is not observed; it is taken to
be the body's.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from gymnasium import spaces

from algorithms.guard_options import Switches
from algorithms.method import Observations
from algorithms.safety_guard import SafetyGuard, limits_to
from envs.compiled import borrowed, njit
from envs.geometry import lane_centre, nearest_lane
from envs.observation import OBSERVATION_SIZE, decode, observation_bounds
from envs.scenario import LANES, PEDESTRIAN_SLOTS, VEHICLE_SLOTS
from envs.world import CROSSING, WAITING, FloatArray, Records, World, empty_world

FEATURES: Final = 6
LIMIT_MAX_MPS2: Final = 40.0
"""Limits beyond it look the same."""


@njit
def scaled(limit: float) -> float:
    """A limit [m/s2] in [-1, 1], fine near 0 and coarse far away."""
    size = math.log1p(min(abs(limit), LIMIT_MAX_MPS2)) / math.log1p(LIMIT_MAX_MPS2)
    return size if limit > 0.0 else -size


@njit
def limits_by_lane(
    ego: Records, vehicles: Records, pedestrians: Records, horizons: FloatArray, shares: FloatArray,
    importance: FloatArray, o: Switches, out: FloatArray,
) -> None:  # fmt: skip
    """Write the features of every world, (N, 6); arguments as in `algorithms.safety_guard.guard_kernel`."""
    ego, vehicles, pedestrians, importance = (
        borrowed(ego),
        borrowed(vehicles),
        borrowed(pedestrians),
        borrowed(importance),
    )
    for i in range(ego.shape[0]):
        own = nearest_lane(ego[i].d)
        for k in range(3):
            lane = own + k - 1
            pre, follow = -math.inf, math.inf
            if 0 <= lane < LANES:
                pre, follow = limits_to(
                    ego, vehicles, pedestrians, i, lane_centre(lane), horizons[i], shares[i], importance, o
                )
            out[i, 2 * k], out[i, 2 * k + 1] = scaled(pre), scaled(follow)


def observed_world(observations: Observations) -> World:
    """The worlds that observations (N, 47) describe: the ego and the bodies that it sees, nearest first."""
    x = decode(observations)
    world = empty_world(len(observations), VEHICLE_SLOTS, PEDESTRIAN_SLOTS)
    ego, vehicles, pedestrians = world.ego, world.vehicles, world.pedestrians
    ego["s"], ego["d"], ego["speed"] = x.s, x.d, x.speed
    ego["lateral_speed"], ego["heading"] = x.lateral_speed, x.heading
    ego["reference_d"], ego["reference_speed"] = x.d, x.lateral_speed
    vehicles["present"] = x.vehicle_present
    vehicles["s"] = x.s[:, None] + x.vehicle_ds
    vehicles["d"] = x.d[:, None] + x.vehicle_dd
    along = np.maximum((x.speed * np.cos(x.heading))[:, None] + x.vehicle_dv, 0.0)
    vehicles["heading"] = x.vehicle_heading
    vehicles["speed"] = along / np.maximum(np.cos(x.vehicle_heading), 0.1)  # no car of the traffic turns so far
    pedestrians["state"] = np.where(x.pedestrian_present, CROSSING, WAITING)
    pedestrians["s"] = x.s[:, None] + x.pedestrian_ds
    pedestrians["d"] = x.d[:, None] + x.pedestrian_dd
    pedestrians["lateral_speed"] = x.pedestrian_speed
    return world


class GuardFeatures:
    """Appends a guard's present limits to observations.

    Attributes:
        size: Entries of an observation and its features, 53.
    """

    size = OBSERVATION_SIZE + FEATURES

    def __init__(self, guard: SafetyGuard) -> None:
        """Show the limits of this guard."""
        self._guard = guard

    @property
    def space(self) -> spaces.Box:
        """Bounds of the augmented observation."""
        low, high = observation_bounds()
        ones = np.ones(FEATURES, np.float32)
        return spaces.Box(np.append(low, -ones), np.append(high, ones), dtype=np.float32)

    def __call__(self, observations: Observations) -> Observations:
        """Observations (N, 47) with their features, (N, 53)."""
        world, demand = observed_world(observations), self._guard.demand(observations)
        out = np.empty((len(observations), FEATURES))
        limits_by_lane(
            world.ego, world.vehicles, world.pedestrians, demand.horizons, demand.shares, demand.importance,
            self._guard.switches, out,
        )  # fmt: skip
        return np.concatenate([observations, out.astype(np.float32)], axis=1)


def features_of(guard: SafetyGuard, aware: bool) -> GuardFeatures | None:
    """The features of a guard for a policy that is to be aware of it, else None."""
    return GuardFeatures(guard) if aware else None

"""A longitudinal control barrier function as a Shield, over N worlds at once."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from envs.geometry import PEDESTRIAN_SIZE_M, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M
from envs.motion import ACCELERATION_MIN_MPS2
from envs.world import CROSSING, BoolArray, FloatArray, World

HEADWAY_S: Final = 3.6
"""T: at 13.89 m/s and -2 m/s2 the ego stops within 3.5 s worth of its speed."""
STANDSTILL_M: Final = 2.0
RATE: Final = 0.5
"""gamma of the barrier [1/s]."""
BESIDE_M: Final = 12.0
"""Nobody may be nearer along the road for a change into his lane."""
MARGIN_M: Final = 0.5


def barrier_acceleration(gap_m: FloatArray, speed_mps: FloatArray, leader_mps: FloatArray) -> FloatArray:
    """Largest acceleration that keeps h = gap - T v - d0 from falling faster than -gamma h [m/s2].

    dh/dt = v_l - v - T a >= -gamma h gives a <= (v_l - v + gamma h) / T.
    Source: Ames, Xu, Grizzle and Tabuada (2017), "Control Barrier Function Based Quadratic Programs for Safety Critical
    Systems", IEEE TAC 62(8), adaptive cruise control; here with a standstill gap d0.

    Args:
        gap_m: Bumper gap, shape (N, K).
        speed_mps: Of the ego, shape (N, 1).
        leader_mps: Of the body ahead, shape (N, K).
    """
    h = gap_m - HEADWAY_S * speed_mps - STANDSTILL_M
    limit: FloatArray = (leader_mps - speed_mps + RATE * h) / HEADWAY_S
    return limit


class BarrierGuard:
    """Keeps the barrier to every body on the way to the lateral target, and the lane where that way is taken."""

    def begin(self, seed: np.random.SeedSequence) -> None:
        """Draws no numbers."""

    def observe(self, observations: NDArray[np.float32]) -> None:
        """Reads the world itself."""

    def filter(
        self, world: World, targets: FloatArray, accelerations: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, None]:
        """See `envs.world.Shield.filter`; its arguments are left as they are."""
        executed = np.where(_taken(world, targets), world.ego["d"], targets)
        limits = np.minimum(_limit_of_cars(world, executed), _limit_of_pedestrians(world))
        limited = np.maximum(np.minimum(accelerations, limits), ACCELERATION_MIN_MPS2)
        return executed, limited, (executed != targets) | (limited != accelerations), None


def _taken(world: World, targets: FloatArray) -> BoolArray:
    """Whether a car is beside or close to the way sideways, in a lane that the ego is not in yet (N,)."""
    ego, cars = world.ego, world.vehicles
    now = np.abs(cars["d"] - ego["d"][:, None]) < VEHICLE_WIDTH_M
    low, high = np.minimum(ego["d"], targets)[:, None], np.maximum(ego["d"], targets)[:, None]
    on_the_way = (cars["d"] > low - VEHICLE_WIDTH_M - MARGIN_M) & (cars["d"] < high + VEHICLE_WIDTH_M + MARGIN_M)
    near = np.abs(cars["s"] - ego["s"][:, None]) < BESIDE_M
    result: BoolArray = ((cars["present"] == 1) & on_the_way & near & ~now).any(axis=1)
    return result


def _limit_of_cars(world: World, targets: FloatArray) -> FloatArray:
    """Barrier's limit of the cars ahead between the ego and its target (N,) [m/s2]; inf where there is none."""
    ego, cars = world.ego, world.vehicles
    low, high = np.minimum(ego["d"], targets)[:, None], np.maximum(ego["d"], targets)[:, None]
    reach = VEHICLE_WIDTH_M + MARGIN_M
    ahead = (cars["present"] == 1) & (cars["s"] > ego["s"][:, None])
    ahead &= (cars["d"] > low - reach) & (cars["d"] < high + reach)
    gap = cars["s"] - ego["s"][:, None] - VEHICLE_LENGTH_M
    limits = np.where(ahead, barrier_acceleration(gap, ego["speed"][:, None], cars["speed"]), np.inf)
    return limits.min(axis=1, initial=np.inf)


def _limit_of_pedestrians(world: World) -> FloatArray:
    """Barrier's limit of everybody who crosses ahead, wherever on the road (N,) [m/s2]."""
    ego, people = world.ego, world.pedestrians
    gap = people["s"] - ego["s"][:, None] - 0.5 * (VEHICLE_LENGTH_M + PEDESTRIAN_SIZE_M)
    ahead = (people["state"] == CROSSING) & (gap > 0.0)
    limits = np.where(ahead, barrier_acceleration(gap, ego["speed"][:, None], np.zeros_like(gap)), np.inf)
    return limits.min(axis=1, initial=np.inf)

"""Worlds written down by hand, for tests of single kernels.

Kernels read records by attribute. Compiled code does that on any structured array; with numba's compiler off only
a record array allows it, so every world here is one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from envs import engine
from envs.driving_env import DrivingVectorEnv
from envs.geometry import nearest_lane
from envs.motion import HORIZON_S
from envs.scenario import Scenario
from envs.traffic import EXPONENT, HEADWAY_S
from envs.world import World, empty_world

Fields = Mapping[str, float]
FAR_BEHIND = {"s": -500.0, "speed": 10.0}
"""The ego, out of everybody's way."""


def people(state: int, s: float, d: float = 0.0) -> dict[str, float]:
    """A pedestrian who crosses at 1 m/s, or waits to."""
    return {"state": state, "s": s, "d": d, "lateral_speed": 1.0}


def readable(world: World) -> World:
    """The same arrays, seen as record arrays."""
    arrays = (world.ego, world.vehicles, world.pedestrians, world.episode)
    return World(*(array.view(np.recarray) for array in arrays))


def one_world(ego: Fields | None = None, vehicles: Sequence[Fields] = (), pedestrians: Sequence[Fields] = ()) -> World:
    """One world of an ego in the middle lane, present vehicles and pedestrians; unnamed fields are 0.

    A vehicle's desired speed is its speed, its target lane the one that it is in, unless they are named.
    """
    world = readable(empty_world(1, len(vehicles), len(pedestrians)))
    world.episode["ttc_min"] = np.inf
    start = {"d": 0.0, **(ego or {})}
    for name, value in {"reference_d": start["d"], "target_d": start["d"], **start}.items():
        world.ego[name][0] = value
    for j, fields in enumerate(vehicles):
        lane = nearest_lane(float(fields.get("d", 0.0)))
        defaults = {
            "present": 1,
            "headway": HEADWAY_S,
            "exponent": EXPONENT,
            "target_lane": lane,
            "desired_speed": fields.get("speed", 0.0),
        }
        for name, value in {**defaults, **fields}.items():
            world.vehicles[name][0, j] = value
    for j, fields in enumerate(pedestrians):
        for name, value in fields.items():
            world.pedestrians[name][0, j] = value
    return world


def advance(
    world: World,
    target: float = 0.0,
    command: float = 0.0,
    *,
    steps: int = 1,
    horizon: float = HORIZON_S,
    speed: float | None = None,
    intervened: bool = False,
    proposed: tuple[float, float] | None = None,
    lane_changes: bool = False,
    fair: bool = True,
    cost_signal: int = 0,
) -> np.ndarray:
    """Advance one world; sums of driving, comfort and risk reward and of cost, (4,). A speed means planning."""
    sums = np.zeros((1, 4))
    asked = (target, command) if proposed is None else proposed
    engine.advance(
        world.ego, world.vehicles, world.pedestrians, world.episode,
        np.array([target]), np.array([command]), np.array([horizon]), np.array([speed or 0.0]),
        np.array([asked[0]]), np.array([asked[1]]), np.array([intervened]),
        steps, speed is not None, lane_changes, fair, cost_signal, sums,
    )  # fmt: skip
    return sums[0]


def driving_env(scenario: Scenario | str, num_envs: int = 1, **arguments: Any) -> DrivingVectorEnv:
    """A vector environment that also steps with numba's compiler off."""
    env = DrivingVectorEnv(scenario, num_envs, **arguments)
    env.world = readable(env.world)
    return env

"""Scenes for the guard, written down by hand, and what it makes of an action there."""

import dataclasses
import math

import numpy as np

from algorithms.guard_options import GuardOptions, Switches
from algorithms.safety_guard import SafetyGuard
from envs.world import CROSSING, empty_world

SWITCHES = Switches(*dataclasses.astuple(GuardOptions()))


def scene(cars=(), people=(), speed=10.0, d=0.0, heading=0.0, kept=None, drift=0.0):
    """One world. Cars are (gap, d, speed), a gap below 0 behind; pedestrians (gap, d, walking speed)."""
    world = empty_world(1, len(cars), len(people))
    world.ego["speed"], world.ego["d"], world.ego["heading"] = speed, d, heading
    world.ego["reference_d"], world.ego["reference_speed"] = d, drift
    world.ego["target_d"] = d if kept is None else kept
    for j, (gap, car_d, car_speed) in enumerate(cars):
        world.vehicles[0, j] = np.zeros((), world.vehicles.dtype)
        world.vehicles["present"][0, j] = 1
        world.vehicles["s"][0, j] = gap + math.copysign(5.0, gap)
        world.vehicles["d"][0, j], world.vehicles["speed"][0, j] = car_d, car_speed
    for j, (gap, person_d, walking) in enumerate(people):
        world.pedestrians["state"][0, j] = CROSSING
        world.pedestrians["s"][0, j] = gap + math.copysign(2.8, gap)
        world.pedestrians["d"][0, j], world.pedestrians["lateral_speed"][0, j] = person_d, walking
    return world


def alongside(ds, car_d, **ego):
    """One car whose centre is ds ahead of the ego's, less than a car's length."""
    world = scene([(1.0, car_d, 10.0)], **ego)
    world.vehicles["s"] = ds
    return world


def guarded(world, target=0.0, acceleration=1.0, tc=3.0, **options):
    targets, accelerations, flags, _ = SafetyGuard(tc, GuardOptions(**options)).filter(
        world, np.array([target]), np.array([acceleration])
    )
    return float(targets[0]), float(accelerations[0]), bool(flags[0])


def limits(world, target=0.0, tc=3.0, **options):
    guard = SafetyGuard(tc, GuardOptions(**options))
    guard.filter(world, np.array([target]), np.array([0.0]))
    return guard.limits[0]

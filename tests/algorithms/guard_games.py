"""A game against the guard: cars that keep their lanes, people who stand, and someone who wants contact.

The ego moves as in the engine (`envs.motion`) and contact is the engine's true overlap; in an `EngineGame` the traffic
is the engine's, too. The adversary proposes at every 0.1 s step whichever of 27 actions leaves, after the guard's
answer, the least room: one step of search, from a state that all earlier steps have worsened.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from algorithms.guard_options import GuardOptions
from algorithms.safety_guard import SafetyGuard
from envs import engine
from envs.engine import find_contact
from envs.geometry import PEDESTRIAN_SIZE_M, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M
from envs.motion import move_ego, steer
from envs.scenario import STEP_S
from envs.world import CROSSING, Fault, World, empty_world

NONE = int(Fault.NONE)
TARGETS = (-4.25, -3.5, -2.4, -1.2, 0.0, 1.2, 2.4, 3.5, 4.25)
ACCELERATIONS = (-2.0, 0.5, 2.0)


@numba.njit
def advance(ego, vehicles, pedestrians, episode, targets, commands, horizons, braking):
    """One step of every world without contact so far; cars change speed by `braking` (N,) until they stand."""
    for i in range(ego.shape[0]):
        if episode[i].fault != NONE:
            continue
        s_before, d_before = ego[i].s, ego[i].d
        move_ego(ego, i, steer(ego, i, targets[i], horizons[i]), commands[i])
        for j in range(vehicles.shape[1]):
            v = vehicles[i, j]
            speed = max(v.speed + braking[i] * STEP_S, 0.0)
            vehicles[i, j].s = v.s + v.speed * STEP_S
            vehicles[i, j].acceleration = (speed - v.speed) / STEP_S
            vehicles[i, j].speed = speed
        ego[i].target_d = targets[i]
        episode[i].fault, episode[i].ego_at_fault = find_contact(ego, vehicles, pedestrians, i, s_before, d_before)


@numba.njit
def room(ego, vehicles, pedestrians, sideways, out):
    """Least room to any body, in both directions; ahead it is what is left once both have stopped at 2 m/s2."""
    for i in range(ego.shape[0]):
        e, least = ego[i], np.inf
        turned = 0.5 * VEHICLE_LENGTH_M * abs(np.sin(e.heading))
        for j in range(vehicles.shape[1] + pedestrians.shape[1]):
            if j < vehicles.shape[1]:
                v = vehicles[i, j]
                if v.present == 0:
                    continue
                ds, dd, speed, length, width = v.s - e.s, v.d - e.d, v.speed, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M
            else:
                p = pedestrians[i, j - vehicles.shape[1]]
                if p.state != CROSSING:
                    continue
                ds, dd, speed, length, width = p.s - e.s, p.d - e.d, 0.0, PEDESTRIAN_SIZE_M, PEDESTRIAN_SIZE_M
            gap = abs(ds) - 0.5 * (VEHICLE_LENGTH_M + length)
            if not sideways:
                gap += (speed * speed - e.speed * e.speed) / 4.0 if ds > 0.0 else 100.0
            side = abs(dd) - 0.5 * (VEHICLE_WIDTH_M + width) - turned - 0.5 * e.lateral_speed * np.sign(dd)
            least = min(least, (gap if gap < 0.0 else 0.3 * gap) + 2.0 * max(side, 0.0))
        out[i] = least


class GuardOfMany(SafetyGuard):
    """The fixed guard with a T_c for each world."""

    def __init__(self, tc: np.ndarray, options: GuardOptions | None = None) -> None:
        super().__init__(options=options)
        self.tc_of_world = tc

    def horizons(self, world: World) -> np.ndarray:
        return self.tc_of_world


class Game:
    """Worlds in which the ego is driven by proposals that a guard filters; cars keep their speed, or brake.

    Attributes:
        world: N worlds; `episode.fault` says who was touched.
        braking: Acceleration of a world's cars until they stand, shape (N,) [m/s2].
    """

    def __init__(self, world: World, braking: np.ndarray) -> None:
        self.world, self.braking = world, braking

    def step(self, guard: Any, targets: np.ndarray, accelerations: np.ndarray) -> None:
        """Carry out what the guard makes of the proposed actions."""
        w = self.world
        safe_targets, safe_accelerations, flags, horizons = guard.filter(w, targets, accelerations)
        self.move(safe_targets, safe_accelerations, horizons, flags)

    def move(self, targets: np.ndarray, commands: np.ndarray, horizons: np.ndarray, flags: np.ndarray) -> None:
        """Execute actions."""
        w = self.world
        advance(w.ego, w.vehicles, w.pedestrians, w.episode, targets, commands, horizons, self.braking)

    def take(self, rows: np.ndarray) -> Game:
        """Copies of some worlds, each as often as it is named."""
        parts = (self.world.ego, self.world.vehicles, self.world.pedestrians, self.world.episode)
        return type(self)(World(*(part[rows] for part in parts)), self.braking[rows])

    @property
    def touched_ahead(self) -> int:
        """Worlds in which the ego touched the (only) body while its centre was ahead."""
        body = self.world.vehicles if self.world.vehicles.shape[1] else self.world.pedestrians
        return int(((self.world.episode["fault"] != NONE) & (body["s"][:, 0] > self.world.ego["s"])).sum())


class EngineGame(Game):
    """The same, with the engine's traffic and pedestrians."""

    def move(self, targets: np.ndarray, commands: np.ndarray, horizons: np.ndarray, flags: np.ndarray) -> None:
        w, n = self.world, len(targets)
        engine.advance(
            w.ego, w.vehicles, w.pedestrians, w.episode, targets, commands, horizons, np.zeros(n),
            targets, commands, flags, 1, False, False, True, 0, np.zeros((n, 4)),
        )  # fmt: skip


def against_adversary(
    game: Game, tc: np.ndarray, steps: int, sideways: bool = False, options: GuardOptions | None = None
) -> Game:
    """The game after so many steps of the worst action; `sideways` seeks contact beside, else ahead."""
    pairs = np.array([(d, a) for d in TARGETS for a in ACCELERATIONS])
    worlds, tries = len(tc), len(pairs)
    targets, accelerations = np.tile(pairs, (worlds, 1)).T.copy()
    guard, worst = GuardOfMany(np.repeat(tc, tries), options), np.empty(worlds * tries)
    for _ in range(steps):
        futures = game.take(np.repeat(np.arange(worlds), tries))
        futures.step(guard, targets, accelerations)
        room(futures.world.ego, futures.world.vehicles, futures.world.pedestrians, sideways, worst)
        worst[futures.world.episode["fault"] != NONE] = -np.inf
        game = futures.take(np.arange(worlds) * tries + worst.reshape(worlds, tries).argmin(1))
    return game


def against_careless(game: Game, tc: np.ndarray, steps: int, draw: Callable[[], tuple[Any, Any]]) -> Game:
    """The game after so many steps of drawn actions, each held for 0.5 s."""
    guard = GuardOfMany(tc)
    for step in range(steps):
        if step % 5 == 0:
            targets, accelerations = draw()
        game.step(guard, targets, accelerations)
    return game


def facing(
    d: np.ndarray, speed: np.ndarray, gap: np.ndarray, other_d: np.ndarray, other_speed: np.ndarray | None,
    braking: np.ndarray | None = None,
) -> Game:  # fmt: skip
    """Egos that drive straight on, and a car so many metres ahead (bumper gap), or a standing pedestrian (no speed).

    All of shape (N,); a gap is negative where the car is beside or behind: then it is the distance of centres.
    """
    world = empty_world(len(d), int(other_speed is not None), int(other_speed is None))
    world.ego["d"] = world.ego["reference_d"] = world.ego["target_d"] = d
    world.ego["speed"] = speed
    if other_speed is None:
        world.pedestrians["state"] = CROSSING
        world.pedestrians["s"][:, 0] = gap + 0.5 * (VEHICLE_LENGTH_M + PEDESTRIAN_SIZE_M)
        world.pedestrians["d"][:, 0] = other_d
    else:
        world.vehicles["present"] = 1
        world.vehicles["s"][:, 0] = gap + VEHICLE_LENGTH_M
        world.vehicles["d"][:, 0], world.vehicles["speed"][:, 0] = other_d, other_speed
    return Game(world, np.zeros(len(d)) if braking is None else braking)

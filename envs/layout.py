"""The random part of a scenario: initial states of episodes, each replayable by its number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from envs import pedestrians as crossing
from envs import traffic
from envs.scenario import (
    EGO_SPEED_MAX_MPS,
    FIRST_SPAWN_M,
    GOAL_M,
    LANE_CAPACITY,
    LANE_WIDTH_M,
    LANES,
    SPACING_M,
    SPAWN_STRETCH_M,
    Scenario,
)
from envs.world import WAITING, FloatArray, World, empty_world

SPEED_MIN_MPS: Final = 8.0
SPEED_MAX_MPS: Final = 12.0
"""Range of start and desired speeds (paper, Sec. V-A)."""
CHUNK: Final = 1024
"""Episodes drawn together."""


def _draw_lanes(rng: np.random.Generator, n: int, vehicles: int) -> np.ndarray:
    """Lanes (n, vehicles), uniform over all ways to fill the spawn places without overfilling a lane."""
    places = np.repeat(np.arange(LANES), LANE_CAPACITY)
    return rng.permuted(np.broadcast_to(places, (n, places.size)), axis=1)[:, :vehicles]


def _draw_positions(rng: np.random.Generator, lanes: np.ndarray) -> FloatArray:
    """Positions (n, vehicles): uniform in each lane given the least spacing."""
    n, vehicles = lanes.shape
    positions = np.empty((n, vehicles))
    for lane in range(LANES):
        member = lanes == lane
        count = member.sum(axis=1, keepdims=True)
        slack = SPAWN_STRETCH_M - FIRST_SPAWN_M - np.maximum(count - 1, 0) * SPACING_M
        draws = np.sort(np.where(member, rng.random((n, vehicles)), np.inf), axis=1)
        rank = np.cumsum(member, axis=1) - 1
        ordered = np.take_along_axis(draws, np.maximum(rank, 0), axis=1)
        positions[member] = (FIRST_SPAWN_M + ordered * slack + rank * SPACING_M)[member]
    return positions


def _fill_traffic(world: World, scenario: Scenario, rng: np.random.Generator) -> None:
    n, count = world.vehicles.shape
    lanes = _draw_lanes(rng, n, count)
    vehicles = world.vehicles
    vehicles["present"] = 1
    vehicles["s"] = _draw_positions(rng, lanes)
    vehicles["d"] = (lanes - (LANES - 1) / 2) * LANE_WIDTH_M
    vehicles["desired_speed"] = rng.uniform(SPEED_MIN_MPS, SPEED_MAX_MPS, (n, count))
    vehicles["headway"] = traffic.HEADWAY_S
    vehicles["exponent"] = traffic.EXPONENT
    vehicles["target_lane"] = lanes
    if scenario.randomised_traffic:
        number = rng.integers(1, count + 1, (n, 1))
        vehicles["present"] = np.arange(count) < number
        slowest = rng.uniform(5.0, SPEED_MAX_MPS, (n, 1))
        fastest = np.minimum(slowest + rng.uniform(0.0, 6.0, (n, 1)), EGO_SPEED_MAX_MPS)
        vehicles["desired_speed"] = slowest + rng.random((n, count)) * (fastest - slowest)
        vehicles["headway"] = rng.uniform(1.0, 2.0, (n, 1))
        vehicles["exponent"] = rng.uniform(3.5, 4.5, (n, count))
    vehicles["speed"] = vehicles["desired_speed"]
    # highway-env starts the lane-change timer from the position.
    vehicles["timer"] = (vehicles["s"] + vehicles["d"]) * np.pi % traffic.LANE_CHANGE_DELAY_S


def _fill_pedestrians(world: World, rng: np.random.Generator) -> None:
    people = world.pedestrians
    shape = people.shape
    side = rng.choice([-1.0, 1.0], shape)
    people["state"] = WAITING
    people["s"] = rng.uniform(80.0, GOAL_M - 20.0, shape)
    people["d"] = side * crossing.KERB_M
    people["lateral_speed"] = -side * rng.uniform(crossing.SPEED_MIN_MPS, crossing.SPEED_MAX_MPS, shape)
    people["trigger_gap"] = rng.uniform(crossing.TRIGGER_GAP_MIN_M, crossing.TRIGGER_GAP_MAX_M, shape)


def sample_initial_worlds(scenario: Scenario, seed: np.random.SeedSequence, n: int) -> World:
    """Draw n initial states; ego, traffic and pedestrians have streams of their own."""
    for_ego, for_traffic, for_pedestrians = (np.random.default_rng(s) for s in seed.spawn(3))
    world = empty_world(n, scenario.vehicles, scenario.pedestrians)
    ego = world.ego
    ego["d"] = (for_ego.integers(0, LANES, n) - (LANES - 1) / 2) * LANE_WIDTH_M
    start = for_ego.uniform(SPEED_MIN_MPS, SPEED_MAX_MPS, n)
    ego["speed"] = 0.0 if scenario.standing_start else start
    ego["reference_d"] = ego["d"]
    ego["target_d"] = ego["d"]
    world.episode["ttc_min"] = np.inf
    _fill_traffic(world, scenario, for_traffic)
    if scenario.pedestrians:
        _fill_pedestrians(world, for_pedestrians)
    return world


@dataclass(slots=True)
class EpisodeSource:
    """A numbered sequence of initial states: episode k is the same whoever asks, and whenever.

    Attributes:
        scenario: What is drawn.
        seed: Names the stream; disjoint streams for training and for the held-out list.
        start: First episode number.
        stop: One past the last, or None for an endless stream.
    """

    scenario: Scenario
    seed: np.random.SeedSequence
    start: int = 0
    stop: int | None = None

    def chunk(self, index: int) -> World:
        """Episodes index * 1024 to (index + 1) * 1024 - 1, numbered in ``episode``."""
        child = np.random.SeedSequence(self.seed.entropy, spawn_key=(*self.seed.spawn_key, index))
        world = sample_initial_worlds(self.scenario, child, CHUNK)
        world.episode["episode"] = np.arange(index * CHUNK, (index + 1) * CHUNK)
        return world


def held_out_source(scenario: Scenario, episodes: int) -> EpisodeSource:
    """The frozen held-out list of a scenario, the same for all methods and seeds."""
    entropy = int.from_bytes(f"held-out {scenario.id}".encode(), "big")
    return EpisodeSource(scenario, np.random.SeedSequence(entropy), 0, episodes)

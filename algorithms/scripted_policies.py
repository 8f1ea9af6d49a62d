"""Policies without learning: constant speed, full throttle, random actions, IDM and a careful overtaker."""

from __future__ import annotations

import json
from abc import abstractmethod
from pathlib import Path
from typing import Final

import numpy as np

from algorithms.method import Actions, Observations, Policy, Shield
from envs.driving_env import action_space
from envs.geometry import PEDESTRIAN_SIZE_M, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M
from envs.motion import ACCELERATION_MAX_MPS2, ACCELERATION_MIN_MPS2
from envs.observation import DecodedObservation, decode
from envs.scenario import EGO_SPEED_MAX_MPS, LANE_WIDTH_M, LANES
from envs.traffic import COMFORT_ACCELERATION_MPS2, COMFORT_BRAKING_MPS2, EXPONENT, HEADWAY_S, JAM_DISTANCE_M
from envs.world import BoolArray, FloatArray

LANE_CENTRES_M: Final = (np.arange(LANES) - (LANES - 1) / 2) * LANE_WIDTH_M
CROSSING_MARGIN_S: Final = 1.5
"""Time before and after a pedestrian's presence in the path that counts as occupied."""


def nearest_lanes(d: FloatArray) -> np.ndarray:
    """Index of the nearest lane for lateral positions (N,) [m]."""
    return np.clip(np.rint(d / LANE_WIDTH_M + (LANES - 1) / 2), 0, LANES - 1).astype(np.int64)


def pedestrian_in_path(o: DecodedObservation, low: FloatArray, high: FloatArray) -> BoolArray:
    """Pedestrians (N, 3) that may be between lateral positions low and high (N,) [m] when the ego arrives.

    It arrives at the earliest at 13.89 m/s and departs at the latest at its present speed.
    """
    half = 0.5 * (VEHICLE_WIDTH_M + PEDESTRIAN_SIZE_M)
    d = o.d[:, None] + o.pedestrian_dd
    walking = np.where(np.abs(o.pedestrian_speed) < 1e-6, 1e-6, o.pedestrian_speed)
    at_low, at_high = (low[:, None] - half - d) / walking, (high[:, None] + half - d) / walking
    enters, leaves = np.minimum(at_low, at_high), np.maximum(at_low, at_high)
    speed = np.maximum(o.speed, 1.0)[:, None]
    reach = 0.5 * (VEHICLE_LENGTH_M + PEDESTRIAN_SIZE_M)
    arrives, departs = (o.pedestrian_ds - reach) / EGO_SPEED_MAX_MPS, (o.pedestrian_ds + reach) / speed
    overlap = (enters - CROSSING_MARGIN_S < departs) & (leaves + CROSSING_MARGIN_S > arrives)
    inside = o.pedestrian_present & (o.pedestrian_ds > -reach) & (leaves > 0.0)
    result: BoolArray = inside & overlap
    return result


def leaders(o: DecodedObservation, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Bodies ahead in the strip between lateral positions low and high (N,) [m].

    Returns:
        Centre distance (N, 8) [m], inf where a body does not count, and speed (N, 8) [m/s].
    """
    d = o.d[:, None] + o.vehicle_dd
    inside = (d > low[:, None] - VEHICLE_WIDTH_M) & (d < high[:, None] + VEHICLE_WIDTH_M)
    ahead = o.vehicle_present & inside & (o.vehicle_ds > 0.0)
    cars = np.where(ahead, o.vehicle_ds, np.inf)
    # A pedestrian is shorter than a car: move it back so that equal distances mean equal bumper gaps.
    shift = 0.5 * (VEHICLE_LENGTH_M - PEDESTRIAN_SIZE_M)
    people = np.where(pedestrian_in_path(o, low, high), o.pedestrian_ds + shift, np.inf)
    distances = np.concatenate([cars, people], axis=1)
    speeds = np.concatenate([o.speed[:, None] + o.vehicle_dv, np.zeros_like(people)], axis=1)
    return distances, speeds


def idm(
    speed: FloatArray, distance: FloatArray, leader_speed: FloatArray,
    acceleration: float = COMFORT_ACCELERATION_MPS2, braking: float = COMFORT_BRAKING_MPS2,
    headway: float = HEADWAY_S, jam_distance: float = JAM_DISTANCE_M,
) -> FloatArray:  # fmt: skip
    """IDM acceleration towards 13.89 m/s behind the most binding leader, within the ego's limits (N,) [m/s2].

    Args:
        speed: Shape (N,) [m/s].
        distance: Centre to centre, inf without a leader, shape (N, K) [m].
        leader_speed: Shape (N, K) [m/s].
        acceleration: IDM's a [m/s2].
        braking: IDM's b [m/s2].
        headway: IDM's T [s].
        jam_distance: IDM's s0, centre to centre [m].
    """
    v = speed[:, None]
    desired = jam_distance + v * headway + v * (v - leader_speed) / (2.0 * np.sqrt(acceleration * braking))
    interaction = (np.maximum(desired, 0.0) / np.maximum(distance, 0.1)) ** 2
    free = 1.0 - (speed / EGO_SPEED_MAX_MPS) ** EXPONENT
    unclipped: FloatArray = acceleration * (free - interaction.max(axis=1))
    return np.clip(unclipped, ACCELERATION_MIN_MPS2, ACCELERATION_MAX_MPS2)


class ScriptedPolicy(Policy):
    """A driver that needs no weights; saved as its name."""

    driver = ""

    def __init__(self, shield: Shield | None = None) -> None:
        """Drive behind a shield, or without."""
        self.shield = shield

    def act(self, observations: Observations) -> Actions:
        """Actions (N, 2) [m, m/s2]."""
        return self.drive(decode(observations))

    @abstractmethod
    def drive(self, o: DecodedObservation) -> Actions:
        """Actions (N, 2) for decoded observations."""

    def save(self, folder: Path) -> None:
        """Write the driver's name."""
        (folder / "driver.json").write_text(json.dumps({"driver": self.driver}) + "\n")


class ConstantSpeedPolicy(ScriptedPolicy):
    """Keeps lane and speed, whatever happens."""

    driver = "constant-speed"

    def drive(self, o: DecodedObservation) -> Actions:
        """Zero offset, zero acceleration."""
        return np.zeros((len(o.s), 2))


class FullThrottlePolicy(ScriptedPolicy):
    """Keeps its lane at full throttle."""

    driver = "full-throttle"

    def drive(self, o: DecodedObservation) -> Actions:
        """Zero offset, 2 m/s2."""
        return np.column_stack([np.zeros(len(o.s)), np.full(len(o.s), ACCELERATION_MAX_MPS2)])


class RandomPolicy(ScriptedPolicy):
    """Uniformly random actions."""

    driver = "random"

    def __init__(self, shield: Shield | None = None) -> None:
        """Draw from a fixed stream until `begin` names one."""
        super().__init__(shield)
        self._rng = np.random.default_rng(0)
        self._space = action_space(self.action_mode)

    def begin(self, worlds: int, seed: np.random.SeedSequence) -> None:
        """Start the stream of this roll-out."""
        self._rng = np.random.default_rng(seed)

    def drive(self, o: DecodedObservation) -> Actions:
        """Uniform over the action space."""
        return self._rng.uniform(self._space.low, self._space.high, (len(o.s), 2))


class IDMPolicy(ScriptedPolicy):
    """highway-env's car-following model as the ego: keeps its lane."""

    driver = "idm"

    def drive(self, o: DecodedObservation) -> Actions:
        """IDM behind the nearest body ahead in the own lane."""
        centre = LANE_CENTRES_M[nearest_lanes(o.d)]
        distances, speeds = leaders(o, np.minimum(o.d, centre), np.maximum(o.d, centre))
        return np.column_stack([np.zeros(len(o.s)), idm(o.speed, distances, speeds)])


class CruisePolicy(ScriptedPolicy):
    """A careful overtaker: seeks the lane in which it can drive fastest, 1.5 s headway, checks its mirrors."""

    driver = "cruise"
    look_ahead_m = 70.0
    gain_min_mps = 0.5

    def drive(self, o: DecodedObservation) -> Actions:
        """Pursue the best reachable lane; follow the slower of the leaders in the present and the new lane."""
        lanes = nearest_lanes(o.d)
        speeds = np.stack([self._lane_speed(o, lane) for lane in range(LANES)], axis=1)
        clear = np.stack([self._clear(o, lane) for lane in range(LANES)], axis=1)
        rows = np.arange(len(lanes))
        target, best = lanes.copy(), speeds[rows, lanes] + self.gain_min_mps
        for step in (-1, 1):
            neighbour = np.clip(lanes + step, 0, LANES - 1)
            better = clear[rows, neighbour] & (speeds[rows, neighbour] > best)
            target = np.where(better, neighbour, target)
            best = np.where(better, speeds[rows, neighbour], best)
        target = self._finish_change(o, lanes, target)
        centre = LANE_CENTRES_M[target]
        distances, leader_speeds = leaders(o, np.minimum(o.d, centre), np.maximum(o.d, centre))
        offset = np.clip(centre - LANE_CENTRES_M[lanes], -LANE_WIDTH_M, LANE_WIDTH_M)
        return np.column_stack([offset, idm(o.speed, distances, leader_speeds, 2.0, 2.0, 1.5, VEHICLE_LENGTH_M + 2.0)])

    def _lane_speed(self, o: DecodedObservation, lane: int) -> FloatArray:
        """Speed that a lane allows within the look-ahead (N,) [m/s]; farther leaders hinder less."""
        centre = np.full(len(o.s), LANE_CENTRES_M[lane])
        distances, speeds = leaders(o, centre + 0.5, centre - 0.5)
        room = np.clip((distances - 15.0) / self.look_ahead_m, 0.0, 1.0)
        allowed: FloatArray = (speeds + (EGO_SPEED_MAX_MPS - speeds) * room).min(axis=1)
        return allowed

    def _clear(self, o: DecodedObservation, lane: int) -> BoolArray:
        """Whether nobody beside, close ahead or coming up from behind forbids a change into a lane (N,)."""
        d = o.d[:, None] + o.vehicle_dd
        inside = o.vehicle_present & (np.abs(d - LANE_CENTRES_M[lane]) < VEHICLE_WIDTH_M + 0.5)
        gap = np.abs(o.vehicle_ds) - VEHICLE_LENGTH_M
        catching_up = np.where(o.vehicle_ds > 0.0, -o.vehicle_dv, o.vehicle_dv)
        needed = 4.0 + 3.0 * np.maximum(catching_up, 0.0)
        result: BoolArray = ~(inside & (gap < needed)).any(axis=1)
        return result

    @staticmethod
    def _finish_change(o: DecodedObservation, lanes: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Once well under way sideways, go on to the lane ahead of the motion."""
        offset = o.d - LANE_CENTRES_M[lanes]
        moving = np.abs(o.lateral_speed) > 0.4
        outward = moving & (np.sign(o.lateral_speed) == np.sign(offset)) & (np.abs(offset) > 0.3)
        onward = np.clip(lanes + np.sign(o.lateral_speed).astype(np.int64), 0, LANES - 1)
        return np.where(outward, onward, np.where(moving, lanes, target))


DRIVERS: Final[dict[str, type[ScriptedPolicy]]] = {
    policy.driver: policy for policy in (ConstantSpeedPolicy, FullThrottlePolicy, RandomPolicy, IDMPolicy, CruisePolicy)
}

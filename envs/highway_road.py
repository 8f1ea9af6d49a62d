"""highway-env's road and its users, with walking pedestrians and with speeds within bounds.

Deviations from highway-env, the same as the engine's: speeds stay within [0, 13.89] m/s (ego) and at or
above 0 (traffic); predicted collisions have no effect; pedestrians are stepped.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from highway_env.road.lane import LineType, StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import RoadObject

from envs.scenario import EGO_SPEED_MAX_MPS, LANE_WIDTH_M, PedestrianRule
from envs.world import CROSSING, GONE, WAITING

LANE_CENTRES_M: Final = (-3.5, 0.0, 3.5)
ROAD_EDGE_M: Final = 5.25
KERB_M: Final = 5.75
ROAD_START_M: Final = -1000.0
ROAD_END_M: Final = 3000.0


def three_lane_network(up: float = 1.0) -> RoadNetwork:
    """Lanes ("0", "1", 0..2) at d = -3.5, 0, 3.5 m; up = -1 mirrors d for pictures, whose y points down."""
    network = RoadNetwork()
    solid, dashed, none = LineType.CONTINUOUS_LINE, LineType.STRIPED, LineType.NONE
    for lane, d in enumerate(LANE_CENTRES_M):
        right, left = (solid if lane == 0 else dashed), (solid if lane == 2 else none)
        line = StraightLane(
            [ROAD_START_M, up * d],
            [ROAD_END_M, up * d],
            width=LANE_WIDTH_M,
            line_types=(right, left) if up > 0 else (left, right),
            speed_limit=None,
        )
        network.add_lane("0", "1", line)
    return network


class EgoVehicle(Vehicle):  # type: ignore[misc]
    """The ego on highway-env's bicycle model; MOBIL reasons about it as a driver who wants v_max."""

    speed: float
    target_speed = EGO_SPEED_MAX_MPS

    def step(self, dt: float) -> None:
        """Move; the speed stays within [0, 13.89] m/s."""
        super().step(dt)
        self.speed = min(max(self.speed, 0.0), EGO_SPEED_MAX_MPS)


class TrafficVehicle(IDMVehicle):  # type: ignore[misc]
    """highway-env's IDM and MOBIL driver."""

    speed: float

    def step(self, dt: float) -> None:
        """Move; the speed stays at or above 0."""
        super().step(dt)
        self.speed = max(self.speed, 0.0)


class Pedestrian(RoadObject):  # type: ignore[misc]
    """A square of 0.6 m that waits at the kerb, crosses once at a constant speed, and is gone."""

    LENGTH = 0.6
    WIDTH = 0.6

    def __init__(self, road: Road, x: float, y: float, walking_speed: float, trigger_gap: float) -> None:
        """Stand at (x, y); walking speed > 0 is towards larger y."""
        super().__init__(road, [x, y], heading=math.pi / 2, speed=walking_speed)
        self.trigger_gap = trigger_gap
        self.state = WAITING


class CrossedRoad(Road):  # type: ignore[misc]
    """A road that steps its pedestrians, and whose vehicles do not feel predicted collisions."""

    def __init__(self, rule: PedestrianRule) -> None:
        """An empty three-lane road; its ego is the first of its vehicles."""
        super().__init__(three_lane_network(), np_random=np.random.RandomState(0))
        self.rule = rule
        self.pedestrians: list[Pedestrian] = []

    def update_objects(self) -> None:
        """Show traffic the pedestrians who are crossing, and no others."""
        self.objects = [p for p in self.pedestrians if p.state == CROSSING]

    def step(self, dt: float) -> None:
        """Move vehicles, then pedestrians; who steps off now moves from the next step on."""
        for vehicle in self.vehicles:
            vehicle.step(dt)
        self.step_pedestrians(dt)

    def step_pedestrians(self, dt: float) -> None:
        """Walk, arrive, or step off."""
        for p in self.pedestrians:
            if p.state == CROSSING:
                p.position = p.position + np.array([0.0, p.speed * dt])
                if p.position[1] * np.sign(p.speed) > KERB_M:
                    p.state = GONE
            elif p.state == WAITING and self._steps_off(p):
                p.state = CROSSING
        self.update_objects()

    def _steps_off(self, p: Pedestrian) -> bool:
        ego, *traffic = self.vehicles
        gap = p.position[0] - ego.position[0] - (ego.LENGTH + p.LENGTH) / 2
        if not 0.0 < gap <= p.trigger_gap:
            return False
        if self.rule is PedestrianRule.FAIR and gap <= 3.6 * ego.speed + 1.0:
            return False
        if any(other.state == CROSSING for other in self.pedestrians):
            return False
        return all(self._lets_cross(car, p) for car in traffic)

    def _lets_cross(self, car: TrafficVehicle, p: Pedestrian) -> bool:
        """Whether a car has passed, or can brake, when the pedestrian reaches its lane, however it drives.

        It has passed if 0.8 of its speed takes its tail 1 m beyond; it can brake (5 m/s2, after 0.5 s) if it can
        even having accelerated at 3 m/s2 up to its desired speed.
        """
        metres = abs(LANE_CENTRES_M[car.lane_index[2]] - p.position[1]) - LANE_WIDTH_M / 2 - 1.0
        seconds = max(0.0, metres) / abs(p.speed)
        ahead, half_lengths = p.position[0] - car.position[0], (car.LENGTH + p.LENGTH) / 2
        if 0.8 * car.speed * seconds - ahead - half_lengths >= 1.0:
            return True
        speed = max(car.speed, min(car.speed + 3.0 * seconds, car.target_speed))
        gap = ahead - speed * seconds - half_lengths
        return bool(gap >= max(1.0, speed**2 / 10.0 + 0.5 * speed))

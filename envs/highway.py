"""The oracle: the same Scenario on highway-env's own vehicles, lanes and road.

Traffic decides and moves by highway-env's `IDMVehicle`, the ego is integrated by its `Vehicle`. What is ours
(pedestrians, contact, endings, rewards, costs) is written down here a second time from its definition, without the
engine's code. Only the ego's plan and its PID (`envs.motion.steer`) are shared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from highway_env import utils
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import RoadObject

from envs.highway_road import LANE_CENTRES_M, ROAD_EDGE_M, CrossedRoad, EgoVehicle, Pedestrian, TrafficVehicle
from envs.motion import HORIZON_S, steer
from envs.scenario import GOAL_M, STEP_S, TIME_LIMIT_S, Scenario
from envs.terms import CostSignal
from envs.world import Ending, Fault, FloatArray, World


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """What one step of 0.1 s gave, each reward term by itself."""

    speed_reward: float
    lane_deviation_reward: float
    collision_reward: float
    comfort_reward: float
    cost: float
    ending: Ending
    fault: Fault

    @property
    def driving_reward(self) -> float:
        """r_s + r_c + r_ld."""
        return self.speed_reward + self.lane_deviation_reward + self.collision_reward


@dataclass(frozen=True, slots=True)
class Positions:
    """(s, d) of the ego (2,), the vehicles (V, 2), NaN where absent, and the pedestrians (P, 2) [m]."""

    ego: FloatArray
    vehicles: FloatArray
    pedestrians: FloatArray


class HighwayOracle:
    """One world on highway-env's classes.

    Args:
        scenario: What is simulated.
        world: Initial states; not changed.
        row: Which of them to start from.
        cost_signal: What costs 1.
    """

    def __init__(
        self, scenario: Scenario, world: World, row: int, cost_signal: CostSignal = CostSignal.COLLISION
    ) -> None:
        """Build the road, its users and the ego's planner at their initial state."""
        self.scenario = scenario
        self.road = CrossedRoad(scenario.pedestrian_rule)
        self.traffic: list[TrafficVehicle | None] = []
        self._cost_signal = cost_signal
        self._plan = world.ego[row : row + 1].copy()
        self._steps = int(world.episode["steps"][row])
        start = self._plan[0]
        self._command = (float(start["target_d"]), float(start["command"]))
        self.ego = EgoVehicle(self.road, [start["s"], start["d"]], float(start["heading"]), float(start["speed"]))
        self.road.vehicles = [self.ego]
        for record in world.vehicles[row]:
            self.traffic.append(self._add_vehicle(record) if record["present"] else None)
        for r in world.pedestrians[row]:
            p = Pedestrian(self.road, r["s"], r["d"], float(r["lateral_speed"]), float(r["trigger_gap"]))
            p.state = int(r["state"])
            self.road.pedestrians.append(p)
        self.road.update_objects()

    def _add_vehicle(self, record: Any) -> TrafficVehicle:
        car = TrafficVehicle(
            self.road,
            [record["s"], record["d"]],
            float(record["heading"]),
            float(record["speed"]),
            target_lane_index=("0", "1", int(record["target_lane"])),
            enable_lane_change=self.scenario.lane_changes,
        )
        # Set after the constructor, which takes 0 for unset.
        car.target_speed = float(record["desired_speed"])
        car.timer = float(record["timer"])
        car.DELTA = float(record["exponent"])
        car.TIME_WANTED = float(record["headway"])
        self.road.vehicles.append(car)
        return car

    def step(self, target_d: float, acceleration: float, horizon_s: float = HORIZON_S) -> StepOutcome:
        """Advance by 0.1 s.

        Args:
            target_d: Lateral target in the road's frame [m].
            acceleration: Commanded; clipped to [-2, 2] [m/s2].
            horizon_s: The lateral planner's horizon [s].
        """
        command = min(max(acceleration, -2.0), 2.0)
        plan = self._plan
        plan["s"], plan["d"] = self.ego.position
        plan["speed"], plan["heading"] = self.ego.speed, self.ego.heading
        self.ego.act({"steering": steer(plan, 0, target_d, horizon_s), "acceleration": command})
        before = {body: body.position.copy() for body in self.road.vehicles}
        self.road.act()
        self.road.step(STEP_S)
        self._steps += 1
        fault = self._find_fault(before)
        target_before, command_before = self._command
        self._command = (target_d, command)
        speed, offsets = self.ego.speed, [abs(self.ego.position[1] - centre) for centre in LANE_CENTRES_M]
        return StepOutcome(
            speed_reward=0.5 * float(np.clip(speed / 8.0, 0.0, 1.0))
            + 4.0 * float(np.clip((speed - 8.0) / (13.89 - 8.0), 0.0, 1.0)),
            lane_deviation_reward=-float(min(offsets)),
            collision_reward=-50.0 if fault else 0.0,
            comfort_reward=-0.5 * (abs(target_d - target_before) / 7.0 + abs(command - command_before) / 4.0),
            cost=self._cost(fault),
            ending=self._find_ending(fault),
            fault=fault,
        )

    def positions(self) -> Positions:
        """Where everybody is now."""
        absent = np.full(2, np.nan)
        return Positions(
            self.ego.position.copy(),
            np.array([absent if car is None else car.position for car in self.traffic]),
            np.array([p.position for p in self.road.pedestrians]).reshape(-1, 2),
        )

    def _touches(self, body: RoadObject) -> bool:
        """True overlap of two oriented rectangles now: highway-env's polygon test without displacement."""
        if np.abs(body.position - self.ego.position).max() > 7.0:
            return False
        still = np.zeros(2)
        return bool(utils.are_polygons_intersecting(self.ego.polygon(), body.polygon(), still, still)[0])

    def _find_fault(self, before: dict[Vehicle, FloatArray]) -> Fault:
        for car in self.road.vehicles[1:]:
            if self._touches(car):
                ds, dd = before[car] - before[self.ego]
                if abs(dd) >= 2.0 and abs(ds) < 5.0:
                    return Fault.SIDE
                return Fault.AHEAD if ds > 0.0 else Fault.REAR_ENDED
        return Fault.PEDESTRIAN if any(map(self._touches, self.road.objects)) else Fault.NONE

    def _find_ending(self, fault: Fault) -> Ending:
        if fault:
            return Ending.COLLISION
        if abs(self.ego.position[1]) > ROAD_EDGE_M:
            return Ending.OFF_ROAD
        if self.ego.position[0] >= GOAL_M:
            return Ending.GOAL
        return Ending.TIME_OUT if self._steps * STEP_S > TIME_LIMIT_S - STEP_S / 2 else Ending.RUNNING

    def _cost(self, fault: Fault) -> float:
        if fault or self._cost_signal is CostSignal.COLLISION:
            return float(bool(fault))
        gap, time_to_collision = self._exposure()
        if self._cost_signal is CostSignal.PROXIMITY:
            return float(gap < 3.6 * self.ego.speed)
        return float(time_to_collision < 1.5)

    def _exposure(self) -> tuple[float, float]:
        """Least bumper gap [m] and time to collision [s] to what is ahead and overlaps the ego's width."""
        gap, time_to_collision = math.inf, math.inf
        for body in [*self.road.vehicles[1:], *self.road.objects]:
            ds, dd = body.position - self.ego.position
            if ds <= 0.0 or abs(dd) >= (body.WIDTH + self.ego.WIDTH) / 2:
                continue
            distance = max(ds - (body.LENGTH + self.ego.LENGTH) / 2, 0.0)
            closing = (self.ego.velocity - body.velocity)[0]
            gap = min(gap, distance)
            if closing > 0.0:
                time_to_collision = min(time_to_collision, distance / closing)
        return gap, time_to_collision

"""One compiled step over N worlds: traffic, ego, pedestrians, contact, endings, rewards, statistics."""

from __future__ import annotations

import math
from typing import Final

import numba

from envs import pedestrians as crossing
from envs import traffic
from envs.compiled import borrowed, njit, njit_parallel
from envs.geometry import (
    PEDESTRIAN_SIZE_M,
    ROAD_EDGE_M,
    VEHICLE_LENGTH_M,
    VEHICLE_WIDTH_M,
    nearest_lane,
    rectangles_overlap,
)
from envs.motion import ACCELERATION_MAX_MPS2, ACCELERATION_MIN_MPS2, move_ego, planned_acceleration, steer
from envs.reward import (
    COLLISION_REWARD,
    LOW_TTC_S,
    RISK_REWARD,
    SAFE_HEADWAY_S,
    comfort_reward,
    lane_deviation_reward,
    path_exposure,
    speed_reward,
)
from envs.scenario import GOAL_M, STEP_S, TIME_LIMIT_S
from envs.terms import CostSignal
from envs.world import CROSSING, BoolArray, Ending, Fault, FloatArray, Records

STEPS_MAX: Final = round(TIME_LIMIT_S / STEP_S)
HARD_BRAKING_MPS2: Final = -1.8
LATERAL_MOTION_MPS: Final = 0.1
"""Lateral speed above which a body counts as moving sideways when fault is judged."""

# Plain integers: numba compiles them in, and records hold them.
RUNNING, GOAL, COLLISION = int(Ending.RUNNING), int(Ending.GOAL), int(Ending.COLLISION)
OFF_ROAD, TIME_OUT = int(Ending.OFF_ROAD), int(Ending.TIME_OUT)
NO_FAULT, AHEAD, SIDE = int(Fault.NONE), int(Fault.AHEAD), int(Fault.SIDE)
REAR_ENDED, PEDESTRIAN = int(Fault.REAR_ENDED), int(Fault.PEDESTRIAN)
COST_PROXIMITY, COST_TTC = int(CostSignal.PROXIMITY), int(CostSignal.TTC)


@njit
def judge_contact(ds: float, dd: float, ego_lateral_speed: float, other_lateral_speed: float) -> tuple[int, int]:
    """Kind of contact between two cars and whether the ego is at fault, from their offset a step before.

    Args:
        ds: Other minus ego along the road before the step [m].
        dd: Other minus ego across the road before the step [m].
        ego_lateral_speed: [m/s].
        other_lateral_speed: [m/s].

    Returns:
        `Fault` and 1 where the ego is at fault: it ran into a car ahead, moved sideways at least as fast as the
        other in a side contact, or was hit from behind while still moving sideways.
    """
    moving = abs(ego_lateral_speed) > LATERAL_MOTION_MPS
    if abs(dd) >= VEHICLE_WIDTH_M and abs(ds) < VEHICLE_LENGTH_M:
        return SIDE, int(moving and abs(ego_lateral_speed) >= abs(other_lateral_speed))
    if ds > 0.0:
        return AHEAD, 1
    return REAR_ENDED, int(moving)


@njit
def find_contact(
    ego: Records, vehicles: Records, pedestrians: Records, i: int, s_before: float, d_before: float
) -> tuple[int, int]:
    """True overlap of ego i with any body at the end of a step: `Fault` and whether the ego is at fault."""
    e = ego[i]
    for j in range(vehicles.shape[1]):
        v = vehicles[i, j]
        if v.present == 1 and rectangles_overlap(
            v.s - e.s, v.d - e.d, e.heading, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M,
            v.heading, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M,
        ):  # fmt: skip
            # The other's position before the step: its last move (traffic.move) undone.
            speed = v.speed - v.acceleration * STEP_S
            slip = math.atan(0.5 * math.tan(v.steering))
            course = v.heading - speed * math.sin(slip) / (VEHICLE_LENGTH_M / 2) * STEP_S + slip
            lateral_speed = speed * math.sin(course)
            s_other = v.s - speed * math.cos(course) * STEP_S
            d_other = v.d - lateral_speed * STEP_S
            return judge_contact(s_other - s_before, d_other - d_before, e.lateral_speed, lateral_speed)
    for j in range(pedestrians.shape[1]):
        p = pedestrians[i, j]
        if p.state == CROSSING and rectangles_overlap(
            p.s - e.s, p.d - e.d, e.heading, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M,
            0.0, PEDESTRIAN_SIZE_M, PEDESTRIAN_SIZE_M,
        ):  # fmt: skip
            return PEDESTRIAN, 1
    return NO_FAULT, 0


@njit
def _count_exposure(
    ego: Records, vehicles: Records, pedestrians: Records, episode: Records, i: int, before: float
) -> tuple[bool, bool]:
    """Add this step to the exposure figures of world i; return whether it was inside S_safe, and below 1.5 s TTC."""
    gap, ttc = path_exposure(ego, vehicles, pedestrians, i)
    close = gap < SAFE_HEADWAY_S * ego[i].speed
    urgent = ttc < LOW_TTC_S
    a = ego[i].acceleration
    episode[i].ttc_min = min(episode[i].ttc_min, ttc)
    episode[i].steps_inside_safe_gap += close
    episode[i].steps_low_ttc += urgent
    episode[i].acceleration_min = min(episode[i].acceleration_min, a)
    episode[i].steps_hard_braking += a <= HARD_BRAKING_MPS2
    episode[i].jerk_sum += abs(a - before) / STEP_S
    error = abs(ego[i].reference_d - ego[i].d)
    episode[i].tracking_error_max = max(episode[i].tracking_error_max, error)
    return close, urgent


@njit
def _find_ending(ego: Records, episode: Records, i: int, fault: int) -> int:
    if fault != NO_FAULT:
        return COLLISION
    if abs(ego[i].d) > ROAD_EDGE_M:
        return OFF_ROAD
    if ego[i].s >= GOAL_M:
        return GOAL
    return TIME_OUT if episode[i].steps >= STEPS_MAX else RUNNING


@njit
def _step_world(
    ego: Records, vehicles: Records, pedestrians: Records, episode: Records, i: int,
    target: float, command: float, horizon: float, lane_changes: bool, fair: bool, cost_signal: int,
) -> tuple[float, float, float]:  # fmt: skip
    """Advance world i by 0.1 s; return driving reward, comfort reward and cost of the step."""
    s_before, d_before, a_before = ego[i].s, ego[i].d, ego[i].acceleration
    lane_before = nearest_lane(d_before)
    traffic.decide(ego, vehicles, pedestrians, i, lane_changes)
    steering = steer(ego, i, target, horizon)
    move_ego(ego, i, steering, command)
    traffic.move(vehicles, i, lane_changes)
    crossing.step(ego, vehicles, pedestrians, i, fair)
    episode[i].steps += 1
    episode[i].distance += ego[i].s - s_before
    episode[i].lane_changes += nearest_lane(ego[i].d) != lane_before
    close, urgent = _count_exposure(ego, vehicles, pedestrians, episode, i, a_before)
    fault, at_fault = find_contact(ego, vehicles, pedestrians, i, s_before, d_before)
    episode[i].fault = fault
    episode[i].ego_at_fault = at_fault
    episode[i].ending = _find_ending(ego, episode, i, fault)
    driving = speed_reward(ego[i].speed) + lane_deviation_reward(ego[i].d)
    if fault != NO_FAULT:
        driving += COLLISION_REWARD
    comfort = comfort_reward(target, ego[i].target_d, command, ego[i].command)
    ego[i].target_d = target
    ego[i].command = command
    costly = fault != NO_FAULT or (cost_signal == COST_PROXIMITY and close) or (cost_signal == COST_TTC and urgent)
    cost = 1.0 if costly else 0.0
    episode[i].return_driving += driving
    episode[i].return_comfort += comfort
    episode[i].cost += cost
    return driving, comfort, cost


@njit
def _advance_world(
    ego: Records, vehicles: Records, pedestrians: Records, episode: Records, i: int,
    targets: FloatArray, commands: FloatArray, horizons: FloatArray, speeds: FloatArray,
    proposed_targets: FloatArray, proposed_commands: FloatArray, intervened: BoolArray,
    substeps: int, planning: bool, lane_changes: bool, fair: bool, cost_signal: int, sums: FloatArray,
) -> None:  # fmt: skip
    for _ in range(substeps):
        if episode[i].ending != RUNNING:
            return
        command = commands[i]
        if planning:
            command = planned_acceleration(ego[i].speed, ego[i].acceleration, speeds[i], horizons[i])
        command = min(max(command, ACCELERATION_MIN_MPS2), ACCELERATION_MAX_MPS2)
        if intervened[i]:
            episode[i].interventions += 1
            episode[i].return_risk += RISK_REWARD
            sums[i, 2] += RISK_REWARD
        change = abs(command - proposed_commands[i]) if not planning else 0.0
        shift = abs(targets[i] - proposed_targets[i])
        episode[i].altered += change > 1e-9 or shift > 1e-9
        episode[i].altered_acceleration += change
        episode[i].altered_target += shift
        driving, comfort, cost = _step_world(
            ego, vehicles, pedestrians, episode, i, targets[i], command, horizons[i],
            lane_changes, fair, cost_signal,
        )  # fmt: skip
        sums[i, 0] += driving
        sums[i, 1] += comfort
        sums[i, 3] += cost


@njit
def advance(
    ego: Records, vehicles: Records, pedestrians: Records, episode: Records,
    targets: FloatArray, commands: FloatArray, horizons: FloatArray, speeds: FloatArray,
    proposed_targets: FloatArray, proposed_commands: FloatArray, intervened: BoolArray,
    substeps: int, planning: bool, lane_changes: bool, fair: bool, cost_signal: int, sums: FloatArray,
) -> None:  # fmt: skip
    """Advance every running world by some steps of 0.1 s under held actions.

    Args:
        ego: `EGO` records, shape (N,).
        vehicles: `VEHICLE` records, shape (N, V).
        pedestrians: `PEDESTRIAN` records, shape (N, P).
        episode: `EPISODE` records, shape (N,); worlds whose episode has ended are left alone.
        targets: Executed lateral targets in the road's frame, shape (N,) [m].
        commands: Executed accelerations, shape (N,) [m/s2]; ignored where planning.
        horizons: Lateral planning horizons, with planning also of the speed, shape (N,) [s].
        speeds: Target speeds, used where planning, shape (N,) [m/s].
        proposed_targets: What the policy asked for, shape (N,) [m].
        proposed_commands: What the policy asked for, shape (N,) [m/s2].
        intervened: Whether a shield flagged these steps, shape (N,).
        substeps: Steps of 0.1 s.
        planning: Whether the acceleration follows a quartic to the target speed (the driving agent's action).
        lane_changes: Whether traffic changes lanes.
        fair: Whether pedestrians spare an ego that cannot stop.
        cost_signal: `CostSignal`.
        sums: Added to, shape (N, 4): driving reward, comfort reward, risk reward, cost.
    """
    ego, vehicles, pedestrians = borrowed(ego), borrowed(vehicles), borrowed(pedestrians)
    episode, sums, intervened = borrowed(episode), borrowed(sums), borrowed(intervened)
    targets, commands, horizons, speeds = borrowed(targets), borrowed(commands), borrowed(horizons), borrowed(speeds)
    proposed_targets, proposed_commands = borrowed(proposed_targets), borrowed(proposed_commands)
    for i in range(ego.shape[0]):
        _advance_world(
            ego, vehicles, pedestrians, episode, i, targets, commands, horizons, speeds, proposed_targets,
            proposed_commands, intervened, substeps, planning, lane_changes, fair, cost_signal, sums,
        )  # fmt: skip


@njit_parallel
def advance_parallel(
    ego: Records, vehicles: Records, pedestrians: Records, episode: Records,
    targets: FloatArray, commands: FloatArray, horizons: FloatArray, speeds: FloatArray,
    proposed_targets: FloatArray, proposed_commands: FloatArray, intervened: BoolArray,
    substeps: int, planning: bool, lane_changes: bool, fair: bool, cost_signal: int, sums: FloatArray,
) -> None:  # fmt: skip
    """`advance` with the worlds shared among numba's threads; bit for bit the same result."""
    for i in numba.prange(ego.shape[0]):
        _advance_world(
            ego, vehicles, pedestrians, episode, i, targets, commands, horizons, speeds, proposed_targets,
            proposed_commands, intervened, substeps, planning, lane_changes, fair, cost_signal, sums,
        )  # fmt: skip

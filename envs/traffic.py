"""Traffic: IDM car-following and MOBIL lane changes exactly as highway-env's `IDMVehicle` defines them."""

from __future__ import annotations

import math
from typing import Final

from envs.compiled import njit
from envs.geometry import VEHICLE_LENGTH_M, lane_centre, nearest_lane
from envs.motion import STEERING_MAX_RAD
from envs.scenario import EGO_SPEED_MAX_MPS, LANE_WIDTH_M, LANES, STEP_S
from envs.world import CROSSING, Records

# Constants of highway-env 1.12, vehicle/behavior.py and vehicle/controller.py.
ACCELERATION_LIMIT_MPS2: Final = 6.0
COMFORT_ACCELERATION_MPS2: Final = 3.0
COMFORT_BRAKING_MPS2: Final = 5.0
JAM_DISTANCE_M: Final = 10.0
"""Centre to centre: 5 m and a car's length."""
HEADWAY_S: Final = 1.5
EXPONENT: Final = 4.0
POLITENESS_GAIN_MIN_MPS2: Final = 0.2
IMPOSED_BRAKING_MAX_MPS2: Final = 2.0
LANE_CHANGE_DELAY_S: Final = 1.0
LANE_MARGIN_M: Final = 1.0
"""A body this far outside a lane's edge still counts as on it."""
GAIN_HEADING: Final = 1.0 / 0.2
GAIN_LATERAL: Final = 1.0 / 0.6

# Participants of a world are numbered: ego 0, vehicles 1..V, pedestrians V+1..V+P; NOBODY is no participant.
NOBODY: Final = -1


@njit
def not_zero(x: float) -> float:
    """highway-env's guard against division by zero: at least 0.01 away from it."""
    if abs(x) > 1e-2:
        return x
    return 1e-2 if x >= 0 else -1e-2


@njit
def idm_acceleration(
    speed: float, desired_speed: float, exponent: float, headway: float, gap: float, closing: float
) -> float:
    """Intelligent Driver Model, unclipped [m/s2].

    Source: Treiber, Hennecke and Helbing (2000), in highway-env's form (distances centre to centre).

    Args:
        speed: Own speed [m/s].
        desired_speed: v0 [m/s].
        exponent: delta.
        headway: Desired time gap [s].
        gap: Distance to the leader's centre [m]; inf without a leader.
        closing: Own speed minus the leader's, along the own heading [m/s].
    """
    ratio = max(speed, 0.0) / abs(not_zero(desired_speed))
    power = ratio * ratio * ratio * ratio if exponent == EXPONENT else ratio**exponent
    acceleration = COMFORT_ACCELERATION_MPS2 * (1.0 - power)
    if gap < math.inf:
        root = math.sqrt(COMFORT_ACCELERATION_MPS2 * COMFORT_BRAKING_MPS2)
        desired_gap = JAM_DISTANCE_M + speed * headway + speed * closing / (2.0 * root)
        share = desired_gap / not_zero(gap)
        acceleration -= COMFORT_ACCELERATION_MPS2 * share * share
    return acceleration


@njit
def _state(ego: Records, vehicles: Records, pedestrians: Records, i: int, k: int) -> tuple[float, float, float, float]:
    """Position, lateral position, speed and heading of participant k; far away if absent."""
    count = vehicles.shape[1]
    if k == 0:
        return ego[i].s, ego[i].d, ego[i].speed, ego[i].heading
    if k <= count:
        v = vehicles[i, k - 1]
        return v.s, v.d, v.speed, v.heading
    p = pedestrians[i, k - 1 - count]
    return p.s, p.d, p.lateral_speed, 0.5 * math.pi


@njit
def _counts(vehicles: Records, pedestrians: Records, i: int, k: int) -> bool:
    """Whether participant k is on the road now."""
    count = vehicles.shape[1]
    if k == 0:
        return True
    if k <= count:
        return bool(vehicles[i, k - 1].present == 1)
    return bool(pedestrians[i, k - 1 - count].state == CROSSING)


@njit
def neighbour(ego: Records, vehicles: Records, pedestrians: Records, i: int, k: int, lane: int, ahead: bool) -> int:
    """Participant next ahead of (or behind) participant k in a lane: highway-env's `Road.neighbour_vehicles`."""
    s = _state(ego, vehicles, pedestrians, i, k)[0]
    centre = lane_centre(lane)
    reach = 0.5 * LANE_WIDTH_M + LANE_MARGIN_M
    nearest = NOBODY
    s_nearest = math.inf if ahead else -math.inf
    for other in range(1 + vehicles.shape[1] + pedestrians.shape[1]):
        if other == k or not _counts(vehicles, pedestrians, i, other):
            continue
        s_other, d_other, _, _ = _state(ego, vehicles, pedestrians, i, other)
        if abs(d_other - centre) > reach:
            continue
        if (s <= s_other <= s_nearest) if ahead else (s_nearest < s_other < s):
            nearest, s_nearest = other, s_other
    return nearest


@njit
def judged_acceleration(
    ego: Records, vehicles: Records, pedestrians: Records, i: int, judge: int, k: int, leader: int
) -> float:
    """IDM acceleration of participant k behind a leader (or NOBODY); 0 for pedestrians and NOBODY [m/s2].

    Highway-env takes the desired speed from the follower, headway and exponent from the vehicle that judges:
    in MOBIL, the one that wants to change lanes.
    """
    count = vehicles.shape[1]
    if k == NOBODY or k > count:
        return 0.0
    s, _, speed, heading = _state(ego, vehicles, pedestrians, i, k)
    desired = vehicles[i, k - 1].desired_speed if k > 0 else EGO_SPEED_MAX_MPS
    exponent, headway = EXPONENT, HEADWAY_S
    if judge > 0:
        exponent, headway = vehicles[i, judge - 1].exponent, vehicles[i, judge - 1].headway
    gap, closing = math.inf, 0.0
    if leader != NOBODY:
        s_leader, _, speed_leader, heading_leader = _state(ego, vehicles, pedestrians, i, leader)
        gap = s_leader - s
        turn = heading_leader - heading
        closing = speed - (speed_leader if turn == 0.0 else speed_leader * math.cos(turn))
    return idm_acceleration(speed, desired, exponent, headway, gap, closing)


@njit
def following_acceleration(ego: Records, vehicles: Records, pedestrians: Records, i: int, k: int, leader: int) -> float:
    """Participant k's own IDM acceleration behind a leader, see `judged_acceleration` [m/s2]."""
    return judged_acceleration(ego, vehicles, pedestrians, i, k, k, leader)


@njit
def _mobil_recommends(ego: Records, vehicles: Records, pedestrians: Records, i: int, k: int, lane: int) -> bool:
    """MOBIL with politeness 0 (Kesting, Treiber and Helbing 2007), highway-env's `IDMVehicle.mobil`."""
    new_behind = neighbour(ego, vehicles, pedestrians, i, k, lane, False)
    imposed = judged_acceleration(ego, vehicles, pedestrians, i, k, new_behind, k)
    if imposed < -IMPOSED_BRAKING_MAX_MPS2:
        return False
    new_ahead = neighbour(ego, vehicles, pedestrians, i, k, lane, True)
    old_ahead = neighbour(ego, vehicles, pedestrians, i, k, nearest_lane(vehicles[i, k - 1].d), True)
    gain = following_acceleration(ego, vehicles, pedestrians, i, k, new_ahead) - following_acceleration(
        ego, vehicles, pedestrians, i, k, old_ahead
    )
    return gain >= POLITENESS_GAIN_MIN_MPS2


@njit
def _must_abort(vehicles: Records, i: int, j: int) -> bool:
    """Whether another vehicle ahead, within the desired gap, is already changing into vehicle j's target lane."""
    own = vehicles[i, j]
    root = math.sqrt(COMFORT_ACCELERATION_MPS2 * COMFORT_BRAKING_MPS2)
    for m in range(vehicles.shape[1]):
        other = vehicles[i, m]
        if m == j or other.present == 0 or other.target_lane != own.target_lane:
            continue
        if nearest_lane(other.d) == own.target_lane:
            continue
        distance = other.s - own.s
        closing = own.speed - other.speed * math.cos(other.heading - own.heading)
        desired = JAM_DISTANCE_M + own.speed * own.headway + own.speed * closing / (2.0 * root)
        if 0.0 < distance < desired:
            return True
    return False


@njit
def decide_lane(ego: Records, vehicles: Records, pedestrians: Records, i: int, j: int) -> None:
    """highway-env's `IDMVehicle.change_lane_policy` for vehicle j of world i."""
    lane = nearest_lane(vehicles[i, j].d)
    if lane != vehicles[i, j].target_lane:
        if _must_abort(vehicles, i, j):
            vehicles[i, j].target_lane = lane
        return
    if vehicles[i, j].timer <= LANE_CHANGE_DELAY_S:
        return
    vehicles[i, j].timer = 0.0
    for candidate in (lane - 1, lane + 1):
        if candidate < 0 or candidate >= LANES or abs(vehicles[i, j].speed) < 1.0:
            continue
        if _mobil_recommends(ego, vehicles, pedestrians, i, j + 1, candidate):
            vehicles[i, j].target_lane = candidate


@njit
def lane_steering(d: float, heading: float, speed: float, lane: int) -> float:
    """highway-env's `ControlledVehicle.steering_control` [rad]."""
    v = not_zero(speed)
    lateral_speed = -GAIN_LATERAL * (d - lane_centre(lane))
    reference = math.asin(min(max(lateral_speed / v, -1.0), 1.0))
    reference = min(max(reference, -0.25 * math.pi), 0.25 * math.pi)
    turn = reference - heading
    turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
    slip = math.asin(min(max(0.5 * VEHICLE_LENGTH_M / v * GAIN_HEADING * turn, -1.0), 1.0))
    steering = math.atan(2.0 * math.tan(slip))
    return min(max(steering, -STEERING_MAX_RAD), STEERING_MAX_RAD)


@njit
def decide(ego: Records, vehicles: Records, pedestrians: Records, i: int, lane_changes: bool) -> None:
    """Acceleration and steering of every vehicle of world i, one after another on shared state."""
    for j in range(vehicles.shape[1]):
        if vehicles[i, j].present == 0:
            continue
        if lane_changes:
            decide_lane(ego, vehicles, pedestrians, i, j)
            v = vehicles[i, j]
            vehicles[i, j].steering = lane_steering(v.d, v.heading, v.speed, v.target_lane)
        lane = nearest_lane(vehicles[i, j].d)
        ahead = neighbour(ego, vehicles, pedestrians, i, j + 1, lane, True)
        a = following_acceleration(ego, vehicles, pedestrians, i, j + 1, ahead)
        if lane_changes and lane != vehicles[i, j].target_lane:
            ahead = neighbour(ego, vehicles, pedestrians, i, j + 1, vehicles[i, j].target_lane, True)
            a = min(a, following_acceleration(ego, vehicles, pedestrians, i, j + 1, ahead))
        vehicles[i, j].acceleration = min(max(a, -ACCELERATION_LIMIT_MPS2), ACCELERATION_LIMIT_MPS2)


@njit
def move(vehicles: Records, i: int, lane_changes: bool) -> None:
    """highway-env's `Vehicle.step` for every vehicle of world i; speed is clamped at 0."""
    for j in range(vehicles.shape[1]):
        v = vehicles[i, j]
        if v.present == 0:
            continue
        if lane_changes:
            slip = math.atan(0.5 * math.tan(v.steering))
            speed, heading = v.speed, v.heading
            vehicles[i, j].s = v.s + speed * math.cos(heading + slip) * STEP_S
            vehicles[i, j].d = v.d + speed * math.sin(heading + slip) * STEP_S
            vehicles[i, j].heading = heading + speed * math.sin(slip) / (VEHICLE_LENGTH_M / 2) * STEP_S
        else:
            vehicles[i, j].s = v.s + v.speed * STEP_S
        speed = v.speed + v.acceleration * STEP_S
        if speed < 0.0:
            vehicles[i, j].acceleration = -v.speed / STEP_S
            speed = 0.0
        vehicles[i, j].speed = speed
        vehicles[i, j].timer = v.timer + STEP_S

"""Pedestrians: they wait at the kerb, step off once, cross at a constant speed."""

from __future__ import annotations

from typing import Final

from envs.compiled import njit
from envs.geometry import PEDESTRIAN_SIZE_M, ROAD_EDGE_M, bumper_gap, lane_centre, nearest_lane
from envs.scenario import LANE_WIDTH_M, STEP_S
from envs.traffic import COMFORT_ACCELERATION_MPS2, COMFORT_BRAKING_MPS2, LANE_MARGIN_M
from envs.world import CROSSING, GONE, WAITING, Records

KERB_M: Final = ROAD_EDGE_M + 0.5
"""Lateral distance of a waiting pedestrian from the road's middle [m]."""
SPEED_MIN_MPS: Final = 0.8
SPEED_MAX_MPS: Final = 1.8
TRIGGER_GAP_MIN_M: Final = 30.0
TRIGGER_GAP_MAX_M: Final = 90.0
FAIR_HEADWAY_S: Final = 3.6
FAIR_MARGIN_M: Final = 1.0
# At up to v_max = 13.89 m/s, 3.6 v + 1 m exceeds the stopping distance v^2 / (2 x 2 m/s2)
# by 1.0 m or more: 1.0 m at rest, 14 m at 7.2 m/s, 2.77 m at v_max.
TRAFFIC_REACTION_S: Final = 0.5
PASSING_SPEED_SHARE: Final = 0.8


@njit
def ego_can_stop(gap: float, speed: float) -> bool:
    """The fair rule: the bumper gap [m] leaves room to stop at -2 m/s2 from this speed [m/s]."""
    return gap > FAIR_HEADWAY_S * speed + FAIR_MARGIN_M


@njit
def car_can_yield(ds: float, speed: float, desired_speed: float, walk: float) -> bool:
    """Whether a car will surely have passed a pedestrian's path, or can surely brake before it, after a time.

    A car that passes is taken at 0.8 of its speed, one that approaches at IDM's full acceleration up to its
    desired speed: what other traffic makes it do meanwhile leaves it gone, or far enough away.

    Args:
        ds: Path minus the car's centre now [m].
        speed: Of the car now [m/s].
        desired_speed: IDM v0 [m/s].
        walk: Time until the pedestrian reaches the car's lane [s].
    """
    slow = ds - PASSING_SPEED_SHARE * speed * walk
    if slow < 0.0 and bumper_gap(slow, PEDESTRIAN_SIZE_M) >= FAIR_MARGIN_M:
        return True
    fastest = max(speed, min(speed + COMFORT_ACCELERATION_MPS2 * walk, desired_speed))
    fast = ds - fastest * walk
    braking = fastest * fastest / (2.0 * COMFORT_BRAKING_MPS2) + TRAFFIC_REACTION_S * fastest
    return fast > 0.0 and bumper_gap(fast, PEDESTRIAN_SIZE_M) >= max(braking, FAIR_MARGIN_M)


@njit
def traffic_can_yield(vehicles: Records, pedestrians: Records, i: int, j: int) -> bool:
    """Whether nobody else is crossing and every car can yield by the time pedestrian j reaches its lane.

    One at a time: a car that stops for a second pedestrian might stop in the path of the first.
    """
    for other in range(pedestrians.shape[1]):
        if pedestrians[i, other].state == CROSSING:
            return False
    p = pedestrians[i, j]
    reach = 0.5 * LANE_WIDTH_M + LANE_MARGIN_M
    for k in range(vehicles.shape[1]):
        v = vehicles[i, k]
        if v.present == 0:
            continue
        way = max(abs(lane_centre(nearest_lane(v.d)) - p.d) - reach, 0.0)
        if not car_can_yield(p.s - v.s, v.speed, v.desired_speed, way / abs(p.lateral_speed)):
            return False
    return True


@njit
def step(ego: Records, vehicles: Records, pedestrians: Records, i: int, fair: bool) -> None:
    """Walk, arrive, or step off: every pedestrian of world i, after the vehicles have moved."""
    for j in range(pedestrians.shape[1]):
        p = pedestrians[i, j]
        if p.state == CROSSING:
            d = p.d + p.lateral_speed * STEP_S
            pedestrians[i, j].d = d
            if (d > KERB_M) if p.lateral_speed > 0.0 else (d < -KERB_M):
                pedestrians[i, j].state = GONE
        elif p.state == WAITING:
            ds = p.s - ego[i].s
            gap = bumper_gap(ds, PEDESTRIAN_SIZE_M)
            wants = ds > 0.0 and 0.0 < gap <= p.trigger_gap
            permits = not fair or ego_can_stop(gap, ego[i].speed)
            if wants and permits and traffic_can_yield(vehicles, pedestrians, i, j):
                pedestrians[i, j].state = CROSSING

"""Pedestrians: they wait at the kerb, step off once, cross at a constant speed."""

from __future__ import annotations

from typing import Final

from envs.compiled import njit
from envs.geometry import PEDESTRIAN_SIZE_M, ROAD_EDGE_M, bumper_gap, lane_centre, nearest_lane
from envs.scenario import LANE_WIDTH_M, STEP_S
from envs.traffic import COMFORT_BRAKING_MPS2, LANE_MARGIN_M
from envs.world import CROSSING, GONE, WAITING, Records

KERB_M: Final = ROAD_EDGE_M + 0.5
"""Lateral distance of a waiting pedestrian from the road's middle [m]."""
SPEED_MIN_MPS: Final = 0.8
SPEED_MAX_MPS: Final = 1.8
TRIGGER_GAP_MIN_M: Final = 30.0
TRIGGER_GAP_MAX_M: Final = 90.0
FAIR_HEADWAY_S: Final = 3.6
FAIR_MARGIN_M: Final = 1.0
# At up to v_max = 13.89 m/s, 3.6 v + 1 m exceeds the stopping distance v^2 / (2 x 2 m/s2) by 2.8 m or more.
TRAFFIC_REACTION_S: Final = 0.5


@njit
def ego_can_stop(gap: float, speed: float) -> bool:
    """The fair rule: the bumper gap [m] leaves room to stop at -2 m/s2 from this speed [m/s]."""
    return gap > FAIR_HEADWAY_S * speed + FAIR_MARGIN_M


@njit
def traffic_can_yield(vehicles: Records, pedestrians: Records, i: int, j: int) -> bool:
    """Whether every car, at constant speed, has passed or can brake when pedestrian j reaches its lane."""
    p = pedestrians[i, j]
    reach = 0.5 * LANE_WIDTH_M + LANE_MARGIN_M
    for k in range(vehicles.shape[1]):
        v = vehicles[i, k]
        if v.present == 0:
            continue
        lane_d = lane_centre(nearest_lane(v.d))
        walk = max(abs(lane_d - p.d) - reach, 0.0)
        ds = p.s - v.s - v.speed * walk / abs(p.lateral_speed)
        gap = bumper_gap(ds, PEDESTRIAN_SIZE_M)
        braking = v.speed * v.speed / (2.0 * COMFORT_BRAKING_MPS2) + TRAFFIC_REACTION_S * v.speed
        if gap < FAIR_MARGIN_M or (ds > 0.0 and gap < braking):
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
            if wants and (not fair or ego_can_stop(gap, ego[i].speed)):
                if traffic_can_yield(vehicles, pedestrians, i, j):
                    pedestrians[i, j].state = CROSSING

"""Whole lane changes of the ego: how long, how far beyond, how calm, and targets at the edge of the road."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from envs.geometry import LANE_WIDTH_M, ROAD_EDGE_M, VEHICLE_WIDTH_M, lane_centre
from envs.motion import COURSE_MAX_RAD, HORIZON_S, LATERAL_ACCELERATION_MAX_MPS2, TARGET_MAX_M
from tests.envs.small_worlds import advance, one_world

pytestmark = pytest.mark.kernels


@dataclass
class LaneChange:
    """A target one lane over, held for 15 s."""

    settled_s: float
    overshoot_m: float
    course_max_rad: float
    tracking_error_max_m: float
    lateral_acceleration_max_mps2: float


def change_lane(speed: float, horizon: float, command: float = 0.0, lanes: tuple[int, int] = (1, 2)) -> LaneChange:
    start, target = (lane_centre(lane) for lane in lanes)
    world = one_world({"speed": speed, "d": start})
    d, courses = [start], []
    for _ in range(150):
        moving = max(float(world.ego.speed[0]), 1e-9)
        advance(world, target, command, horizon=horizon)
        d.append(float(world.ego.d[0]))
        courses.append(math.asin(world.ego.lateral_speed[0] / moving))
    beyond = (np.array(d) - target) * np.sign(target - start)
    return LaneChange(
        settled_s=0.1 * (1 + np.flatnonzero(np.abs(beyond) > 0.1)[-1]),
        overshoot_m=float(max(beyond.max(), 0.0)),
        course_max_rad=float(np.abs(courses).max()),
        tracking_error_max_m=float(world.episode.tracking_error_max[0]),
        lateral_acceleration_max_mps2=float(np.abs(np.diff(d, 2)).max() / 0.01),
    )


SETTLED_S = {0.5: 2.7, 3.0: 3.4, 4.0: 4.6, 7.0: 8.0}
"""Time until the ego stays within 0.1 m of the new lane's centre, for each planning horizon."""


@pytest.mark.parametrize("speed", [8.0, 10.0, 13.89])
@pytest.mark.parametrize("horizon", SETTLED_S)
def test_a_lane_change_settles_without_entering_the_third_lane(speed: float, horizon: float) -> None:
    change = change_lane(speed, horizon, lanes=(0, 1))
    assert change.settled_s == pytest.approx(SETTLED_S[horizon])
    assert change.overshoot_m < 0.06
    assert VEHICLE_WIDTH_M / 2 + change.overshoot_m < LANE_WIDTH_M / 2
    assert change.tracking_error_max_m < 1e-6
    assert change.course_max_rad < COURSE_MAX_RAD
    assert change.lateral_acceleration_max_mps2 < LATERAL_ACCELERATION_MAX_MPS2
    # The road is symmetric.
    assert change_lane(speed, horizon, lanes=(2, 1)).settled_s == change.settled_s


def test_a_lane_change_at_the_default_horizon_takes_3_to_5_seconds() -> None:
    assert 3.0 <= SETTLED_S[HORIZON_S] <= 5.0


@pytest.mark.parametrize("horizon", SETTLED_S)
def test_a_lane_change_from_rest_is_calm(horizon: float) -> None:
    change = change_lane(0.0, horizon, command=2.0)
    assert change.settled_s <= SETTLED_S[horizon] + 1.2
    assert change.overshoot_m < 0.06
    assert change.tracking_error_max_m < 1e-6
    assert change.lateral_acceleration_max_mps2 < LATERAL_ACCELERATION_MAX_MPS2


def test_a_target_beside_a_standing_ego_moves_nothing() -> None:
    world = one_world({"s": 7.0})
    advance(world, 3.5, steps=600)
    ego = world.ego[0]
    assert (ego.s, ego.d, ego.speed, ego.heading, ego.reference_d) == (7.0, 0.0, 0.0, 0.0, 0.0)


def test_the_outermost_target_keeps_the_body_on_the_road() -> None:
    assert pytest.approx(ROAD_EDGE_M) == TARGET_MAX_M + VEHICLE_WIDTH_M / 2
    world = one_world({"speed": 10.0, "d": 3.5})
    advance(world, TARGET_MAX_M, steps=100)
    assert world.ego.d[0] == pytest.approx(TARGET_MAX_M, abs=0.02)
    assert world.ego.d[0] < ROAD_EDGE_M


@pytest.mark.parametrize("speed", [1.0, 8.0, 13.89])
def test_targets_that_flip_at_every_decision_stay_tracked(speed: float) -> None:
    rng = np.random.default_rng(int(speed))
    world = one_world({"speed": speed})
    for _ in range(100):
        advance(world, float(rng.uniform(-TARGET_MAX_M, TARGET_MAX_M)), steps=5)
        assert abs(world.ego.heading[0]) < COURSE_MAX_RAD + 0.05
        assert abs(world.ego.d[0]) < ROAD_EDGE_M
    assert world.episode.tracking_error_max[0] < 0.1

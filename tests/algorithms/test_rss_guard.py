"""RSS: its formulas by hand, the answer to each danger in constructed states, and many careless drivers behind it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from algorithms.method import Budget, Task
from algorithms.registry import get_method
from algorithms.rss import (
    gap_needed_ahead,
    gap_needed_behind,
    gap_needed_beside,
    lateral_safe_distance,
    longitudinal_safe_distance,
)
from algorithms.rss_guard import REST_HORIZON_S, RSSGuard, extents, rest_distance
from bench.stress import stress_guard
from envs.driving_env import DrivingVectorEnv
from envs.motion import plan_lateral
from envs.scenario import get_scenario
from envs.world import CROSSING, WAITING, empty_world


def scene(cars=(), people=(), speed=10.0, d=0.0, drift=0.0, heading=0.0):
    """One world. Cars are (centre distance, d, speed, heading), pedestrians (centre distance, d, walking speed)."""
    world = empty_world(1, len(cars), len(people))
    world.ego["speed"], world.ego["d"], world.ego["reference_d"] = speed, d, d
    world.ego["reference_speed"], world.ego["heading"] = drift, heading
    for j, (ds, car_d, car_speed, car_heading) in enumerate(cars):
        world.vehicles["present"][0, j] = 1
        world.vehicles["s"][0, j], world.vehicles["d"][0, j] = ds, car_d
        world.vehicles["speed"][0, j], world.vehicles["heading"][0, j] = car_speed, car_heading
    for j, (ds, person_d, walking) in enumerate(people):
        world.pedestrians["state"][0, j] = CROSSING
        world.pedestrians["s"][0, j], world.pedestrians["d"][0, j] = ds, person_d
        world.pedestrians["lateral_speed"][0, j] = walking
    return world


def guarded(world, target=0.0, acceleration=1.0):
    """Target, acceleration, flag and horizon."""
    answer = RSSGuard().filter(world, np.array([target]), np.array([acceleration]))
    return tuple(column[0].item() for column in answer)


# --- Formulas -------------------------------------------------------------------------------------------------


def test_the_longitudinal_distance_worked_by_hand():
    # rho 1 s, a 2, b_min 4, b_max 8: (10 + 12) / 2 + 144 / 8 - 64 / 16 = 11 + 18 - 4.
    assert longitudinal_safe_distance(10.0, 8.0, 1.0, 2.0, 4.0, 8.0) == pytest.approx(25.0)
    assert longitudinal_safe_distance(1.0, 30.0, 1.0, 2.0, 4.0, 8.0) == 0.0
    # The ego behind a leader, both 10 m/s: (10 + 10.4) 0.1 + 10.4^2 / 4 - 100 / 12.
    assert gap_needed_ahead(10.0, 10.0) == pytest.approx(2.04 + 27.04 - 8.33333, abs=1e-4)
    # A follower at 12 m/s behind an ego at 4 m/s: (12 + 12.6) 0.1 + 12.6^2 / 10 - 16 / 4.
    assert gap_needed_behind(4.0, 12.0) == pytest.approx(2.46 + 15.876 - 4.0)


def test_the_lateral_distance_worked_by_hand():
    # rho 1 s, a 1, b 2, mu 0.1: own (0.5 + 1.5) / 2 + 2.25 / 4; other, moving away, (-2 - 1) / 2 - 1 / 4.
    assert lateral_safe_distance(0.5, -2.0, 1.0, 1.0, 2.0, 0.1) == pytest.approx(0.1)
    assert lateral_safe_distance(0.5, -0.5, 1.0, 1.0, 2.0, 0.1) == pytest.approx(0.1 + 1.5625 + 0.0 + 0.0625)
    # Both at rest: mu + 2 (0.6 * 0.1 + 0.36 / 2).
    assert gap_needed_beside(0.0, 0.0) == pytest.approx(0.2 + 2 * 0.24)


@given(v=st.floats(0, 13.89), leader=st.floats(0, 13.89), more=st.floats(0.01, 3))
def test_more_speed_needs_more_gap_and_a_faster_leader_less(v, leader, more):
    assert gap_needed_ahead(v + more, leader) >= gap_needed_ahead(v, leader)
    assert gap_needed_ahead(v, leader + more) <= gap_needed_ahead(v, leader)
    assert gap_needed_beside(v / 10 + more, 0.0) > gap_needed_beside(v / 10, 0.0)


@given(v=st.floats(0, 13.69), leader=st.floats(0, 13.89), beyond=st.floats(0, 1))
def test_the_gap_ahead_lets_the_ego_stop_in_steps_behind_a_leader_that_brakes_hardest(v, leader, beyond):
    # The worst allowed: full throttle for the one step in which the gap still held, then full braking.
    gap = gap_needed_ahead(v, leader) + beyond
    acceleration = 2.0
    while v > 0.0:
        gap += 0.1 * (leader - v)
        v = min(max(v + 0.1 * acceleration, 0.0), 13.89)
        leader = max(leader - 0.6, 0.0)
        acceleration = -2.0
        assert gap > 0.0


@given(v=st.floats(0, 2.2), a=st.floats(-1.7, 1.7), step=st.floats(0, 2.5))
def test_the_gap_beside_holds_the_way_to_rest_after_one_more_step(v, a, step):
    after = max(v + 0.1 * step, 0.0)
    assert gap_needed_beside(v, 0.0) >= 0.1 * v + rest_distance(after, step) - 1e-9


@given(v=st.floats(0.05, 2), a=st.floats(-1.5, 1.5))
def test_the_lateral_answer_comes_to_rest_within_the_distance_it_foresees(v, a):
    world = empty_world(1, 0, 0)
    world.ego["speed"], world.ego["reference_speed"], world.ego["reference_acceleration"] = 10.0, v, a
    farthest = 0.0
    for _ in range(60):
        plan_lateral(world.ego, 0, world.ego["reference_d"][0], REST_HORIZON_S)
        farthest = max(farthest, float(world.ego["reference_d"][0]))
    assert farthest <= rest_distance(v, a) + 0.05
    assert abs(world.ego["reference_speed"][0]) < 0.01


@given(v=st.floats(-2, 2), a=st.floats(-2.2, 2.2))
def test_what_is_swept_on_the_way_to_rest_does_not_grow_on_that_way(v, a):
    def strip(ego):
        d, v, a = (float(ego[name][0]) for name in ("reference_d", "reference_speed", "reference_acceleration"))
        return d - rest_distance(-v, -a), d + rest_distance(v, a)

    world = empty_world(1, 0, 0)
    world.ego["speed"], world.ego["reference_speed"], world.ego["reference_acceleration"] = 10.0, v, a
    low, high = strip(world.ego)
    for _ in range(30):
        plan_lateral(world.ego, 0, world.ego["reference_d"][0], REST_HORIZON_S)
        now_low, now_high = strip(world.ego)
        assert now_low >= low - 0.05
        assert now_high <= high + 0.05


def test_a_turned_car_is_wider_and_shorter():
    assert extents(0.0) == pytest.approx((2.5, 1.0))
    assert extents(math.pi / 2) == pytest.approx((1.0, 2.5))
    assert extents(-0.3) == pytest.approx((2.5 * math.cos(0.3) + math.sin(0.3), math.cos(0.3) + 2.5 * math.sin(0.3)))


# --- Answers --------------------------------------------------------------------------------------------------


def test_without_danger_the_action_passes():
    assert guarded(scene(), 3.5, 1.7) == (3.5, 1.7, False, 3.0)


def test_too_close_behind_a_leader_the_ego_brakes_as_hard_as_it_must():
    # Needed at 10 m/s each: 20.747 m bumper to bumper, 25.747 m centre to centre.
    assert guarded(scene([(25.8, 0.0, 10.0, 0.0)])) == (0.0, 1.0, False, 3.0)
    assert guarded(scene([(25.7, 0.0, 10.0, 0.0)])) == (0.0, -2.0, True, 3.0)
    assert guarded(scene([(25.7, 0.0, 10.0, 0.0)]), acceleration=-2.0) == (0.0, -2.0, False, 3.0)


def test_a_follower_in_the_own_lane_is_no_danger_that_the_ego_answers_to():
    assert guarded(scene([(-8.0, 0.0, 13.0, 0.0)])) == (0.0, 1.0, False, 3.0)


@pytest.mark.parametrize("ds", [0.0, 4.0, 12.0, -4.0])
def test_beside_or_close_behind_a_car_of_the_next_lane_the_ego_may_stay_but_not_drift_there(ds):
    car = (ds, 3.5, 10.0, 0.0)
    assert guarded(scene([car]), 0.0) == (0.0, 1.0, False, 3.0)
    assert guarded(scene([car]), 3.5) == (3.5, 1.0, False, 3.0), "at rest sideways, 1.5 m between the bodies"
    assert guarded(scene([car], drift=0.8), 3.5) == (0.0, 1.0, True, REST_HORIZON_S)
    assert guarded(scene([car], drift=-0.8), -3.5) == (-3.5, 1.0, False, 3.0), "away is free"


def test_the_mirror_image_gets_the_mirrored_answer():
    left = guarded(scene([(3.0, 3.5, 10.0, 0.0)], drift=0.8), 3.5)
    right = guarded(scene([(3.0, -3.5, 10.0, 0.0)], drift=-0.8), -3.5)
    assert left == (0.0, 1.0, True, REST_HORIZON_S)
    assert right == (0.0, 1.0, True, REST_HORIZON_S)


def test_a_fast_follower_in_the_target_lane_forbids_the_change_and_a_slow_one_does_not():
    assert guarded(scene([(-8.0, 3.5, 13.0, 0.0)], drift=0.8, speed=5.0), 3.5)[:3] == (0.0, 1.0, True)
    assert guarded(scene([(-8.0, 3.5, 9.0, 0.0)], drift=0.8, speed=10.0), 3.5) == (3.5, 1.0, False, 3.0)


def test_at_rest_beside_a_near_car_a_target_beyond_it_becomes_the_present_place():
    target, acceleration, flagged, _ = guarded(scene([(0.0, 2.6, 10.0, 0.0)]), 3.5)
    assert (target, acceleration, flagged) == (0.0, 1.0, True)
    assert guarded(scene([(0.0, 2.6, 10.0, 0.0)]), -3.5)[0] == -3.5


def test_a_car_that_cuts_in_is_answered_by_braking():
    # 12 m ahead, 0.5 m between the bodies, coming closer at 10 sin 0.1 = 1 m/s.
    assert guarded(scene([(12.0, 2.9, 10.0, -0.1)]))[1] == -2.0
    assert guarded(scene([(12.0, 3.9, 10.0, 0.1)]))[1] == 1.0


def test_a_pedestrian_on_the_way_is_braked_for_within_the_stopping_distance_only():
    # At 10 m/s: 2.04 + 27.04 m, and 2.8 m between centres.
    assert guarded(scene(people=[(31.8, 0.0, 0.0)]))[1] == -2.0
    assert guarded(scene(people=[(32.0, 0.0, 0.0)]))[1] == 1.0
    assert guarded(scene(people=[(31.8, 0.0, 1.5)]))[1] == 1.0, "he leaves before the ego can arrive"
    assert guarded(scene(people=[(30.0, -5.0, 1.0)]))[1] == -2.0, "he comes"
    assert guarded(scene(people=[(30.0, 5.0, 1.0)]))[1] == 1.0, "he has gone by"
    assert guarded(scene(people=[(-5.0, 0.0, 1.0)]))[1] == 1.0


def test_a_pedestrian_of_the_target_lane_stops_the_lane_change():
    assert guarded(scene(people=[(20.0, 3.0, 1.0)], drift=0.5), 3.5) == (0.0, -2.0, True, REST_HORIZON_S)
    assert guarded(scene(people=[(0.5, 3.0, 1.0)]), 3.5) == (0.0, -2.0, True, REST_HORIZON_S), "beside the ego"
    assert guarded(scene(people=[(20.0, 3.0, 1.0)]), 0.0) == (0.0, 1.0, False, 3.0), "the lane kept"


def test_the_ego_goes_on_braking_where_it_would_just_come_to_rest_clear_of_a_pedestrian():
    # Episode 2177 of the stress in b: two steps of full throttle here, and 3 s later it hit him.
    world = scene(people=[(16.36, 0.06, -1.58)], speed=6.89, d=-0.08, drift=-0.25, heading=0.03)
    world.ego["reference_acceleration"] = -2.39
    assert guarded(world, -3.5, 2.0)[1] == -2.0


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_ego_comes_to_rest_beside_a_car_if_its_lateral_acceleration_lets_it(side):
    # 0.3 m between the bodies; at 0.8 m/s towards it 1.03 (0.3 + a / 16) m: 0.44 m at 2 m/s2, 0.18 m at -2 m/s2.
    world = scene([(12.0, 2.3 * side, 10.0, 0.0)], drift=0.8 * side)
    world.ego["reference_acceleration"] = 2.0 * side
    assert guarded(world) == (0.0, -2.0, True, 3.0)
    world.ego["reference_acceleration"] = -2.0 * side
    assert guarded(world) == (0.0, 1.0, True, REST_HORIZON_S)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_pedestrian_beyond_the_way_to_rest_is_kept_clear_of_by_coming_to_rest(side):
    # The strip at rest ends 1.03 (0.3 + a / 16) + 1.3 m aside, he 0.3 m before 1.9 m: in it at 2 m/s2, not at -2 m/s2.
    world = scene(people=[(20.0, 1.9 * side, 0.0)], drift=0.8 * side)
    world.ego["reference_acceleration"] = 2.0 * side
    assert guarded(world, 3.5 * side) == (3.5 * side, -2.0, True, 3.0)
    world.ego["reference_acceleration"] = -2.0 * side
    assert guarded(world, 3.5 * side) == (0.0, -2.0, True, REST_HORIZON_S)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_pedestrian_beside_the_ego_is_braked_for_if_he_walks_towards_it(side):
    # He gets from 2.5 m to 1 m within the second: into the strip, which ends at 1.3 m; or away from it.
    assert guarded(scene(people=[(0.5, 2.5 * side, -1.5 * side)]))[1] == -2.0
    assert guarded(scene(people=[(0.5, 2.5 * side, 1.5 * side)]))[1] == 1.0
    assert guarded(scene(people=[(20.0, 2.5 * side, -1.5 * side)]))[1] == -2.0
    assert guarded(scene(people=[(20.0, 2.5 * side, 1.5 * side)]))[1] == 1.0


def test_who_waits_is_not_there():
    world = scene(people=[(20.0, 0.0, 1.0)])
    world.pedestrians["state"] = WAITING
    assert guarded(world) == (0.0, 1.0, False, 3.0)


def test_no_argument_is_changed_and_each_world_is_judged_by_itself():
    env = DrivingVectorEnv("b", 32, shield=RSSGuard())
    env.reset(seed=3)
    for _ in range(40):
        env.step(np.tile([3.5, 2.0], (32, 1)))
    before = env.world.copy()
    targets, accelerations = np.full(32, 3.5), np.full(32, 2.0)
    together = RSSGuard().filter(env.world, targets, accelerations)
    for name in ("ego", "vehicles", "pedestrians", "episode"):
        assert getattr(env.world, name).tobytes() == getattr(before, name).tobytes()
    assert (targets == 3.5).all()
    assert (accelerations == 2.0).all()
    assert together[2].any()
    assert not together[2].all()
    for i in range(32):
        rows = (getattr(before, name)[i : i + 1] for name in ("ego", "vehicles", "pedestrians", "episode"))
        alone = RSSGuard().filter(type(before)(*rows), targets[:1], accelerations[:1])
        assert [column[0] for column in alone] == [column[i] for column in together]


# --- Driving --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scenario", ["a", "b"])
def test_careless_drivers_cause_no_collision(scenario):
    found = stress_guard(scenario, 3.0, 300, shield_factory=lambda _: RSSGuard())
    assert (found.ego_at_fault, found.off_road) == (0, 0)
    assert found.intervention_ratio > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("driver", ["random", "full-throttle", "full-throttle-lane-change", "cruise"])
@pytest.mark.parametrize("scenario", ["a", "b"])
def test_no_driver_causes_a_collision_in_ten_thousand_episodes(scenario, driver):
    found = stress_guard(scenario, 3.0, 10_000, driver, shield_factory=lambda _: RSSGuard())
    assert (found.collisions, found.off_road) == (0, 0)


def test_the_method_trains_saves_and_loads_at_a_token_budget(tmp_path):
    method = get_method("rss-guard")
    task = Task(get_scenario("b"), 0, Budget(1600), cache=tmp_path)
    policy = method.train(task)
    assert task.steps_done() == 1600
    assert isinstance(policy.shield, RSSGuard)
    folder = tmp_path / "policy"
    folder.mkdir()
    policy.save(folder)
    loaded = method.load_policy(folder, task)
    assert isinstance(loaded.shield, RSSGuard)
    observations = np.zeros((4, 47), np.float32)
    assert np.array_equal(policy.act(observations), loaded.act(observations))

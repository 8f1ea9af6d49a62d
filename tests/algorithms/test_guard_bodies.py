"""Alg. 2 in constructed states: which cars and pedestrians count, and where the guard goes instead."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from algorithms.corridor import pedestrian_counts
from algorithms.critical_acceleration import stopping_bound
from envs.world import GONE, WAITING
from tests.algorithms.guard_scenes import alongside, guarded, limits, scene

pytestmark = pytest.mark.kernels


def test_a_car_in_another_lane_counts_only_in_the_literal_reading():
    world = scene([(20.0, 3.5, 10.0)])
    assert guarded(world) == (0.0, 1.0, False)
    assert guarded(world, literal_all_lanes=True) == (0.0, -2.0, True)


def test_the_corridor_ends_at_the_target_with_a_margin():
    # Half the ego and 0.3 m beyond the target, 1 m before the car's centre: it counts from 3.5 - 1 - 1.3 = 1.2 m on.
    world = scene([(20.0, 3.5, 10.0)])
    assert guarded(world, target=1.19)[2] is False
    assert guarded(world, target=1.21) == (0.0, 1.0, True)


def test_a_leader_counts_on_either_side_until_the_ego_has_left_its_lane():
    for side in (-1.0, 1.0):
        world = scene([(34.0, 0.0, 10.0)], d=2.29 * side)
        assert guarded(world, target=3.5 * side)[1] == pytest.approx(-4.0 / 9.0)
        world = scene([(34.0, 0.0, 10.0)], d=2.31 * side)
        assert guarded(world, target=3.5 * side)[1] == 1.0


def test_a_car_that_drifts_into_the_corridor_counts():
    # Its centre at 3.5 m moves by -0.5 m/s for 3 s: its side gets to 1 m.
    world = scene([(20.0, 3.5, 10.0)])
    world.vehicles["heading"] = -0.05
    assert limits(world)[0] < 0.0
    world.vehicles["heading"] = 0.05
    assert limits(world)[0] == math.inf


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_car_counts_from_the_drift_on_that_carries_it_into_the_corridor(side):
    # Its side, 2.5 m away, and the strip's edge at 1.3 m: 10 m/s sin h 3 s > 1.2 m, sin h > 0.04.
    world = scene([(20.0, 3.5 * side, 10.0)])
    for heading, counts in ((-0.041, True), (-0.039, False), (0.041, False)):
        world.vehicles["heading"] = side * math.asin(heading)
        assert (limits(world)[0] < 0.0) == counts


def test_a_turned_car_goes_along_the_road_at_the_cosine_of_its_heading():
    # Ahead 2 (40 - 36 + 3 (10 cos 0.3 - 10)) / 9; behind, on the way to its lane, 2 (-40 + 36 + 3 (...)) / 9.
    slower = 10.0 * math.cos(0.3) - 10.0
    for heading in (-0.3, 0.3):
        world = scene([(40.0, 0.0, 10.0)])
        world.vehicles["heading"] = heading
        assert limits(world)[0] == pytest.approx(2.0 * (4.0 + 3.0 * slower) / 9.0)
        world = scene([(-40.0, 3.5, 10.0)])
        world.vehicles["heading"] = heading
        assert limits(world, target=3.5)[1] == pytest.approx(2.0 * (-4.0 + 3.0 * slower) / 9.0)


def test_a_follower_that_drifts_towards_the_ego_is_still_one_of_its_own_lane():
    # It will be behind the ego within 3 s (10 sin 0.1 3 = 3 m), but now it is beside it: the change is into its way.
    world = scene([(-40.0, 3.5, 10.0)])
    world.vehicles["heading"] = -0.1
    expected = 2.0 * (-4.0 + 30.0 * (math.cos(0.1) - 1.0)) / 9.0
    assert limits(world, target=3.5)[1] == pytest.approx(expected)


def test_an_absent_car_does_not_count():
    world = scene([(20.0, 0.0, 10.0)])
    world.vehicles["present"] = 0
    assert guarded(world) == (0.0, 1.0, False)


@pytest.mark.parametrize("ds", [-4.9, -2.0, 0.0, 2.0, 4.9])
@pytest.mark.parametrize("tc", [0.5, 3.0, 7.0])
def test_a_lane_change_into_a_car_alongside_is_refused(ds, tc):
    for side in (-1.0, 1.0):
        assert guarded(alongside(ds, 3.5 * side), target=3.5 * side, tc=tc) == (0.0, 1.0, True)
        assert guarded(alongside(ds, 3.5 * side), target=-3.5 * side, tc=tc) == (-3.5 * side, 1.0, False)


def test_a_car_beside_the_rear_half_hinders_only_a_motion_towards_it():
    # At d = 1.25 m the ego's strip overlaps the car's by 5 cm; braking would not part them.
    world = alongside(-2.0, 3.5, d=1.25)
    assert guarded(world, target=0.0) == (0.0, 1.0, False)
    assert guarded(world, target=1.25) == (1.25, 1.0, False)
    assert guarded(world, target=3.5) == (0.0, 1.0, True)


def test_a_car_beside_the_front_half_is_let_past():
    assert guarded(alongside(2.0, 3.5, d=1.25), target=0.0) == (0.0, -2.0, True)


def test_a_lane_change_before_a_fast_follower_is_refused_and_before_a_slow_one_is_not():
    assert guarded(scene([(-8.0, 3.5, 13.0)]), target=3.5)[0] == 0.0
    assert guarded(scene([(-60.0, 3.5, 8.0)]), target=3.5)[0] == 3.5


def test_a_follower_in_the_target_lane_forbids_hard_braking():
    # 2 (-40 + 36) / 9 = -0.889.
    assert guarded(scene([(-40.0, 3.5, 10.0)]), target=3.5, acceleration=-2.0) == (3.5, pytest.approx(-8 / 9), True)


def test_limits_that_no_acceleration_keeps_refuse_the_lane_change():
    # In the target lane a_pre = 2 (34 - 36) / 9 < a_follow = 2 (-34 + 36) / 9, both within what the ego has.
    world = scene([(34.0, 3.5, 10.0), (-34.0, 3.5, 10.0)])
    assert guarded(world, target=3.5) == (0.0, 1.0, True)
    # a_pre = 2 (20 - 36) / 9 < -2, alone.
    assert guarded(scene([(20.0, 3.5, 10.0)]), target=3.5) == (0.0, 1.0, True)
    # a_follow = 2 (-20 + 36) / 9 > 2, alone.
    assert guarded(scene([(-20.0, 3.5, 10.0)]), target=3.5) == (0.0, 1.0, True)


def test_a_pedestrian_counts_until_he_has_surely_left():
    # To the strip's left edge and his half width 1.3 + 0.3 - 0.4 = 1.5 m less 0.3: 1.2 m at 1 m/s and 0.3 s margin,
    # 1.5 s. At 10 m/s and full throttle the ego needs (sqrt(100 + 4 * 17.25) - 10) / 2 = 1.5 s for 17.25 m.
    assert not pedestrian_counts(17.26, 0.4, 1.0, -1.3, 1.3, 10.0)
    assert pedestrian_counts(17.24, 0.4, 1.0, -1.3, 1.3, 10.0)


def test_a_pedestrian_who_has_left_or_stands_outside_does_not_count():
    assert not pedestrian_counts(5.0, 1.61, 1.0, -1.3, 1.3, 10.0)
    assert not pedestrian_counts(5.0, -1.61, -1.0, -1.3, 1.3, 10.0)
    assert not pedestrian_counts(5.0, 1.61, 0.0, -1.3, 1.3, 10.0)
    assert not pedestrian_counts(5.0, -1.61, 0.0, -1.3, 1.3, 10.0)
    assert pedestrian_counts(500.0, 1.59, 0.0, -1.3, 1.3, 10.0)
    assert pedestrian_counts(500.0, -1.59, 0.0, -1.3, 1.3, 10.0)


@given(st.floats(0.0, 100.0), st.floats(-6.0, 6.0), st.floats(-2.0, 2.0), st.floats(0.0, 13.89))
def test_pedestrians_are_judged_alike_from_either_side(gap, d, walking, speed):
    assert pedestrian_counts(gap, d, walking, -1.3, 1.3, speed) == pedestrian_counts(
        gap, -d, -walking, -1.3, 1.3, speed
    )


def test_a_pedestrian_who_approaches_counts_from_the_kerb_on():
    # 2 (30 - 36 - 30) / 9 < -2, from either kerb; none once he is gone, waits, or walks off the strip.
    for side in (-1.0, 1.0):
        world = scene([], [(30.0, 5.7 * side, -side)])
        assert guarded(world) == (0.0, -2.0, True)
        assert guarded(scene([], [(30.0, 2.0 * side, side)])) == (0.0, 1.0, False)
        for state in (WAITING, GONE):
            world.pedestrians["state"] = state
            assert guarded(world) == (0.0, 1.0, False)


def test_a_pedestrian_is_a_body_that_does_not_move_along_the_road():
    # 2 (70 - 36 + 3 * (-10)) / 9.
    assert limits(scene([], [(70.0, 0.0, 0.0)]))[0] == pytest.approx(8.0 / 9.0)
    # At 7 s: 2 (23.5 - 36 - 70) / 49 = -3.4, the reserve of 23.5 m: nothing but full braking and more.
    assert limits(scene([], [(23.5, 0.0, 0.0)]), tc=7.0)[0] == pytest.approx(stopping_bound(23.5, 10.0, 0.0))
    assert limits(scene([], [(23.5, 0.0, 0.0)]), tc=7.0, reserve=False)[0] == pytest.approx(-165.0 / 49.0)


def test_a_pedestrian_behind_does_not_count_and_one_beside_only_for_a_motion_towards_him():
    world = scene([], [(-1.0, 0.0, 0.0)])
    assert guarded(world) == (0.0, 1.0, False)
    beside = scene([], [(1.0, 2.5, 1.0)])
    beside.pedestrians["s"] = -1.0
    assert guarded(beside, target=3.5) == (0.0, 1.0, True)
    assert guarded(beside, target=-3.5) == (-3.5, 1.0, False)
    beside.pedestrians["s"] = 1.0
    assert guarded(beside, target=3.5) == (0.0, 1.0, True)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_pedestrian_beside_the_front_half_is_braked_for_and_one_beside_the_rear_half_only_approached(side):
    # He stands at 1.2 m, within the strip's 1.3 m. Moving away from him, or on, is free once his half has passed.
    world = scene([], [(1.0, 1.2 * side, 0.0)])
    for ds, towards, kept in ((1.0, True, True), (0.0, True, False), (-1.0, True, False)):
        world.pedestrians["s"] = ds
        assert limits(world, target=1.0 * side, hold=False)[0] == (-math.inf if kept else math.inf)
        assert (limits(world)[0] == -math.inf) == kept
        assert guarded(world, target=-3.5 * side)[2] == kept
        assert guarded(world, target=1.0 * side)[2] == towards


def test_all_lanes_means_all_pedestrians_too():
    world = scene([], [(30.0, 5.0, 1.0)])
    assert guarded(world) == (0.0, 1.0, False)
    assert guarded(world, literal_all_lanes=True) == (0.0, -2.0, True)


def test_where_the_lane_centre_is_blocked_too_the_last_target_is_held():
    # The ego passes at d = -1.8 m, as it had been allowed to; the man stands at -3.7 m, in the way to the centre.
    world = scene([], [(14.8, -3.7, 0.0)], speed=13.0, d=-1.8, kept=-1.8)
    assert guarded(world, target=-4.2) == (-1.8, 1.0, True)
    assert guarded(world, target=-4.2, hold=False) == (-3.5, -2.0, True)


def test_where_nothing_is_free_the_way_with_more_room_is_taken():
    # To the centre at 0 a man at 20 m, on the held way to 3.5 m a car at 30 m; both too near for 13 m/s.
    world = scene([(30.0, 3.5, 0.0)], [(20.0, -1.2, 0.0)], speed=13.0, d=1.4, kept=3.5)
    assert guarded(world, target=-3.5) == (3.5, -2.0, True)
    world = scene([(15.0, 3.5, 0.0)], [(20.0, -1.2, 0.0)], speed=13.0, d=1.1, kept=3.5)
    assert guarded(world, target=-3.5) == (0.0, -2.0, True)


def test_where_both_ways_are_blocked_by_the_same_man_the_ego_stays_on_its_way():
    # He stands in both; what moves the ego less far towards him is the held target.
    world = scene([], [(10.0, 4.0, 0.0)], speed=8.0, d=2.5, kept=2.5)
    assert guarded(world, target=4.25) == (2.5, -2.0, True)


def test_beside_two_cars_the_lane_centre_is_better_than_a_way_into_one():
    # Bodies alongside on the held way and on the way back: Alg. 2 keeps the lane.
    world = scene([(1.0, 3.5, 5.0), (1.0, -2.2, 5.0)], d=0.0, kept=3.5)
    world.vehicles["s"] = 1.0
    assert guarded(world, target=3.4) == (0.0, -2.0, True)


def test_a_held_target_that_leads_to_a_follower_that_cannot_brake_is_given_up():
    # From behind at d = 0, 5 m where braking takes 13.8 m; the ego's motion carries it into his way, wherever it aims.
    world = scene([(-5.0, 0.0, 18.0)], d=-2.35, kept=4.25, drift=1.0)
    assert limits(world, target=-3.5, hold=False) == pytest.approx([math.inf, math.inf])
    assert guarded(world, target=3.5) == (-3.5, 2.0, True)
    assert guarded(world, target=3.5, give_way=False) == (4.25, 2.0, True)

"""Alg. 2 in constructed states: which bodies count, what each option changes, how limits become actions."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from algorithms.corridor import corridor, lateral_extent, lateral_response, pedestrian_counts, reach
from algorithms.critical_acceleration import sca, stopping_bound
from algorithms.guard_options import GuardOptions, Switches
from algorithms.safety_guard import SafetyGuard, require_horizon
from envs.motion import plan_lateral
from envs.world import CROSSING, GONE, WAITING, World, empty_world

pytestmark = pytest.mark.kernels


def scene(cars=(), people=(), speed=10.0, d=0.0, heading=0.0, kept=None, drift=0.0):
    """One world. Cars are (gap, d, speed), a gap below 0 behind; pedestrians (gap, d, walking speed)."""
    world = empty_world(1, len(cars), len(people))
    world.ego["speed"], world.ego["d"], world.ego["heading"] = speed, d, heading
    world.ego["reference_d"], world.ego["reference_speed"] = d, drift
    world.ego["target_d"] = d if kept is None else kept
    for j, (gap, car_d, car_speed) in enumerate(cars):
        world.vehicles[0, j] = np.zeros((), world.vehicles.dtype)
        world.vehicles["present"][0, j] = 1
        world.vehicles["s"][0, j] = gap + math.copysign(5.0, gap)
        world.vehicles["d"][0, j], world.vehicles["speed"][0, j] = car_d, car_speed
    for j, (gap, person_d, walking) in enumerate(people):
        world.pedestrians["state"][0, j] = CROSSING
        world.pedestrians["s"][0, j] = gap + math.copysign(2.8, gap)
        world.pedestrians["d"][0, j], world.pedestrians["lateral_speed"][0, j] = person_d, walking
    return world


def alongside(ds, car_d, **ego):
    """One car whose centre is ds ahead of the ego's, less than a car's length."""
    world = scene([(1.0, car_d, 10.0)], **ego)
    world.vehicles["s"] = ds
    return world


def guarded(world, target=0.0, acceleration=1.0, tc=3.0, **options):
    targets, accelerations, flags, _ = SafetyGuard(tc, GuardOptions(**options)).filter(
        world, np.array([target]), np.array([acceleration])
    )
    return float(targets[0]), float(accelerations[0]), bool(flags[0])


def limits(world, target=0.0, tc=3.0, **options):
    guard = SafetyGuard(tc, GuardOptions(**options))
    guard.filter(world, np.array([target]), np.array([0.0]))
    return guard.limits[0]


# --- T_c and shapes -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tc", [0.0, -1.0, math.nan, math.inf, -math.inf])
def test_an_unusable_adjustment_time_is_named(tc):
    with pytest.raises(ValueError, match="T_c"):
        require_horizon(tc)
    with pytest.raises(ValueError, match="T_c"):
        SafetyGuard(tc)


@pytest.mark.parametrize("tc", [0.0, -1.0, math.nan, math.inf])
def test_an_unusable_adjustment_time_of_one_world_is_named_with_the_world(tc):
    class Adjustable(SafetyGuard):
        def horizons(self, world):
            return np.array([3.0, tc])

    with pytest.raises(ValueError, match=r"T_c .* in world 1"):
        Adjustable().filter(empty_world(2, 1, 0), np.zeros(2), np.zeros(2))


@pytest.mark.parametrize("bodies", [(0, 0), (3, 0), (0, 2), (3, 2)])
def test_an_empty_world_passes_the_action_through(bodies):
    world = empty_world(1, *bodies)
    world.pedestrians["state"] = WAITING
    assert guarded(world, target=3.5, acceleration=1.7) == (3.5, 1.7, False)
    assert tuple(limits(world)) == (math.inf, -math.inf)


def test_the_planner_gets_three_seconds_or_a_longer_adjustment_time():
    for tc, expected in ((0.5, 3.0), (3.0, 3.0), (7.0, 7.0)):
        assert SafetyGuard(tc).filter(empty_world(2, 1, 0), np.zeros(2), np.zeros(2))[3] == pytest.approx(expected)


def test_an_acceleration_beyond_what_the_ego_has_is_clipped_without_a_flag():
    assert guarded(scene(), acceleration=2.5) == (0.0, 2.0, False)
    assert guarded(scene(), acceleration=-2.5) == (0.0, -2.0, False)


def test_one_guard_follows_worlds_of_changing_number_and_size():
    guard = SafetyGuard(3.0)
    for n, cars in ((2, 1), (5, 1), (5, 4), (1, 0)):
        assert len(guard.filter(empty_world(n, cars, 2), np.zeros(n), np.zeros(n))[0]) == n


# --- Limits in the ego's lane ---------------------------------------------------------------------------------


def test_the_leader_limits_the_acceleration_to_the_critical_one():
    # Gap 34 m, S_safe 36 m, equal speeds, T_c 3 s: 2 (34 - 36) / 9.
    world = scene([(34.0, 0.0, 10.0)])
    assert guarded(world) == (0.0, pytest.approx(-4.0 / 9.0), True)
    assert guarded(world, acceleration=-1.0) == (0.0, -1.0, False)
    assert guarded(scene([(80.0, 0.0, 10.0)])) == (0.0, 1.0, False)


def test_the_relative_speed_counts_as_leader_minus_ego():
    # 2 (40 - 36 + 3 (8 - 10)) / 9 = -4 / 9; a leader that draws off, 12 m/s: 2 (4 + 6) / 9.
    assert limits(scene([(40.0, 0.0, 8.0)]))[0] == pytest.approx(-4.0 / 9.0)
    assert limits(scene([(40.0, 0.0, 12.0)]))[0] == pytest.approx(20.0 / 9.0)


def test_the_most_binding_of_several_leaders_counts():
    # 2 (34 - 36) / 9 near, 2 (60 - 36) / 9 far.
    world = scene([(60.0, 0.0, 10.0), (34.0, 0.0, 10.0)])
    assert limits(world)[0] == pytest.approx(-4.0 / 9.0)


def test_the_printed_selection_takes_the_least_binding_leader():
    world = scene([(34.0, 0.0, 10.0), (60.0, 0.0, 10.0)])
    assert limits(world, literal_selection=True)[0] == pytest.approx(48.0 / 9.0)
    assert guarded(world)[1] == pytest.approx(-4.0 / 9.0)
    assert guarded(world, literal_selection=True) == (0.0, 1.0, False)


class Ranked(SafetyGuard):
    def __init__(self, ranks, **options):
        super().__init__(3.0, GuardOptions(**options))
        self.ranks = ranks

    def importance(self, world):
        return np.array([self.ranks])


def test_importance_shifts_the_choice_but_not_the_value():
    # a: 2 (34 - 36) / 9 = -0.444 and 2 (37 - 36) / 9 = 0.222. Keys without rank -0.464 and 0.202: the first binds.
    # With IR 1 for the second 0.222 - 0.94 = -0.718: it binds, with its own a.
    world = scene([(34.0, 0.0, 10.0), (37.0, 0.0, 10.0)])
    for ranks, expected in (((0.0, 0.0), -4.0 / 9.0), ((0.0, 1.0), 2.0 / 9.0), ((1.0, 1.0), -4.0 / 9.0)):
        guard = Ranked(ranks)
        guard.filter(world, np.zeros(1), np.zeros(1))
        assert guard.limits[0, 0] == pytest.approx(expected)


def test_importance_raises_a_follower_and_a_pedestrian():
    # Behind in the target lane: -0.889 and -1.111 at 40 and 41 m; IR 1 lets the second bind: -1.111 + 0.94 > -0.869.
    world = scene([(-40.0, 3.5, 10.0), (-41.0, 0.5, 10.0)])
    for ranks, expected in (((0.0, 0.0), -8.0 / 9.0), ((0.0, 1.0), -10.0 / 9.0)):
        guard = Ranked(ranks, literal_followers=True)
        guard.filter(world, np.array([3.5]), np.zeros(1))
        assert guard.limits[0, 1] == pytest.approx(expected)
    # A car at -0.444 and a pedestrian at 2 (66.5 - 36 - 30) / 9 = 0.111.
    world = scene([(34.0, 0.0, 10.0)], [(66.5, 0.0, 0.0)])
    for ranks, expected in (((0.0, 0.0), -4.0 / 9.0), ((0.0, 1.0), 1.0 / 9.0)):
        guard = Ranked(ranks)
        guard.filter(world, np.zeros(1), np.zeros(1))
        assert guard.limits[0, 0] == pytest.approx(expected)


def test_no_rank_and_no_selection_moves_the_braking_reserve():
    # 20 m behind a standing car at 10 m/s nothing is left; a far car of the highest rank binds by Eq. (SCA).
    world = scene([(20.0, 0.0, 0.0), (45.0, 0.0, 12.0)])
    guard = Ranked((0.0, 1.0), literal_selection=True)
    guard.filter(world, np.zeros(1), np.zeros(1))
    assert guard.limits[0, 0] == pytest.approx(stopping_bound(20.0, 10.0, 0.0))


def test_a_follower_in_the_own_lane_counts_only_in_the_literal_reading():
    # 2 (-34 + 36) / 9 behind.
    world = scene([(-34.0, 0.0, 10.0)])
    assert guarded(world, acceleration=0.0) == (0.0, 0.0, False)
    assert guarded(world, acceleration=0.0, literal_followers=True) == (0.0, pytest.approx(4.0 / 9.0), True)


def test_a_follower_that_the_ego_half_covers_is_one_of_the_own_lane():
    # At d = 1.25 m the strip reaches to 2.55 m, the car's side to 2.5 m; at 1.15 m not.
    car = (-3.0, 3.5, 13.0)
    assert guarded(scene([car], d=1.25), target=3.5) == (3.5, 1.0, False)
    assert guarded(scene([car], d=1.15), target=3.5) == (0.0, 1.0, True)


def test_the_preceding_limit_wins_over_the_following_one():
    # a_pre = -4/9 ahead, a_follow = 4/9 behind: conflict in the own lane.
    world = scene([(34.0, 0.0, 10.0), (-34.0, 0.0, 10.0)])
    assert guarded(world, acceleration=0.0, literal_followers=True) == (0.0, pytest.approx(-4.0 / 9.0), True)


def test_the_printed_longitudinal_rule_jumps_to_the_upper_limit():
    # Behind: a_follow = 4/9; ahead nothing binds: the printed rule takes a_pre, clipped to 2.
    world = scene([(-34.0, 0.0, 10.0)])
    assert guarded(world, acceleration=0.0, literal_followers=True)[1] == pytest.approx(4.0 / 9.0)
    assert guarded(world, acceleration=0.0, literal_followers=True, literal_longitudinal=True)[1] == 2.0


@given(st.floats(-100.0, 100.0), st.floats(-2.0, 2.0), st.sampled_from([0.5, 1.0, 3.0, 7.0]))
def test_the_executed_acceleration_keeps_the_limits_and_an_action_within_them_is_kept(gap, acceleration, tc):
    world = scene([(gap if abs(gap) > 0.1 else 0.1, 0.0, 9.0)])
    guard = SafetyGuard(tc)
    _, executed, flags, _ = guard.filter(world, np.zeros(1), np.array([acceleration]))
    pre, follow = guard.limits[0]
    assert executed[0] <= max(pre, -2.0)
    assert flags[0] == (not follow <= acceleration <= pre)
    assert flags[0] or executed[0] == acceleration


# --- The braking reserve --------------------------------------------------------------------------------------


def test_the_reserve_brakes_where_a_long_adjustment_time_would_not():
    # 5 m before a standing car at 4 m/s: 2 (5 - 14.4 - 28) / 49 = -1.53, but 4 m to stop in and 1 m clearance.
    world = scene([(5.0, 0.0, 0.0)], speed=4.0)
    assert guarded(world, tc=7.0, reserve=False)[1] == pytest.approx(-1.527, abs=1e-3)
    assert guarded(world, tc=7.0)[1] == -2.0


def test_the_reserve_takes_the_whole_speed_of_an_ego_that_drives_askew():
    # Straightened up it goes on along the road at 4 m/s, not at 4 cos 0.3; Eq. (SCA) takes the speed along the road.
    world = scene([(5.0, 0.0, 0.0)], speed=4.0, heading=0.3)
    assert limits(world, tc=7.0)[0] == pytest.approx(stopping_bound(5.0, 4.0, 0.0))
    along = 4.0 * math.cos(0.3)
    assert limits(world, tc=7.0, reserve=False)[0] == pytest.approx(sca(5.0, 3.6 * along, -along, 7.0))


def test_the_reserve_keeps_out_of_the_way_of_a_follower_that_can_not_brake():
    # 13^2 / 10 + 3.9 - 10^2 / 4 < 0: clearance only, 1 m; Eq. (SCA) at 7 s: 2 (-0.5 + 36 + 7 dv) / 49 < 2.
    world = scene([(-0.5, 3.5, 11.0)])
    assert guarded(world, target=3.5, tc=7.0, reserve=False)[0] == 3.5
    assert guarded(world, target=3.5, tc=7.0)[0] == 0.0


# --- Which cars count -----------------------------------------------------------------------------------------


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


# --- Which pedestrians count ----------------------------------------------------------------------------------


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


def test_all_lanes_means_all_pedestrians_too():
    world = scene([], [(30.0, 5.0, 1.0)])
    assert guarded(world) == (0.0, 1.0, False)
    assert guarded(world, literal_all_lanes=True) == (0.0, -2.0, True)


# --- Where else to go: hold -----------------------------------------------------------------------------------


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


# --- The corridor ---------------------------------------------------------------------------------------------


def test_the_corners_of_a_turned_body_count():
    # Half width 1 cos 0.2 + 2.5 sin 0.2 + 0.3 = 1.777 m: from d = 0.9 m to 2.677 m, beyond the car's side at 2.5 m.
    for side in (-1.0, 1.0):
        world = alongside(2.0, 3.5 * side, d=0.9 * side, heading=0.2)
        assert guarded(world, target=0.9 * side)[1] == -2.0
        assert guarded(world, target=0.9 * side, turned_body=False) == (0.9 * side, 1.0, False)


def test_the_excursion_of_a_lateral_motion_counts():
    # 2 m/s to the left at the target: the way goes on to 0.2186 * 2 * 3 = 1.31 m, and 1.3 m more: beyond 2.5 m.
    for side in (-1.0, 1.0):
        world = alongside(2.0, 3.5 * side, drift=2.0 * side)
        assert guarded(world)[1] == -2.0
        assert guarded(world, excursion=False) == (0.0, 1.0, False)
        assert guarded(alongside(2.0, -3.5 * side, drift=2.0 * side)) == (0.0, 1.0, False)


SWITCHES = Switches(*dataclasses.astuple(GuardOptions()))


def test_the_corridor_by_hand():
    world = scene(speed=10.0, d=0.5)
    c = corridor(world.ego[0], 3.5, 3.0, SWITCHES)
    # It overshoots nowhere from rest; half a width and 0.3 m on both sides.
    assert (c.low, c.high, c.own_low, c.own_high) == pytest.approx((-0.8, 4.8, -0.8, 1.8))
    assert (c.left, c.right, c.speed) == (True, False, 10.0)
    # 3.6 * 10 + 3 * 10 + 1.5 * 9 + 3 + 5.
    assert c.reach == pytest.approx(87.5)
    assert not corridor(world.ego[0], 0.505, 3.0, SWITCHES).left


def test_the_response_is_that_of_the_quintic_made_anew_at_every_step():
    response = lateral_response(8)
    assert response.shape == (8, 3)
    # At rest on the target nothing moves; one horizon later a tenth of a deviation is left.
    assert response[-1] == pytest.approx([0.0930, 0.0527, 0.0094], abs=1e-4)
    assert response[:, 1].max() == pytest.approx(0.2186, abs=1e-4)


@given(
    st.floats(-1.0, 1.0),
    st.floats(-2.0, 2.0),
    st.floats(-1.0, 1.0),
    st.floats(-3.5, 3.5),
    st.sampled_from([3.0, 5.0, 7.0]),
)
def test_the_extent_holds_the_way_that_the_planner_takes(d, rate, acceleration, target, horizon):
    world = scene(d=d, speed=13.0, drift=rate)
    world.ego["reference_acceleration"] = acceleration
    low, high = lateral_extent(world.ego[0], target, horizon)
    assert low <= min(d, target)
    assert high >= max(d, target)
    way = []
    for _ in range(round(2 * horizon / 0.1)):
        plan_lateral(world.ego, 0, target, horizon)
        way.append(world.ego["reference_d"][0])
    # Eight samples and a horizon that shrinks on the way miss the extremes by less than half the margin kept.
    assert low - 0.15 <= min(way)
    assert max(way) <= high + 0.15


@given(
    st.floats(0.5, 7.0), st.floats(0.0, 13.89), st.floats(0.0, 14.0), st.floats(0.0, 50.0), st.floats(-2.0, 2.0),
    st.booleans(),
)  # fmt: skip
def test_no_body_beyond_the_reach_changes_an_action(tc, speed, other, beyond, acceleration, walks):
    gap = reach(speed, tc) - 5.0 + beyond + 1e-6
    near = (30.0, 0.0, 9.0)
    far = (
        scene([near], [(gap + 2.2, 0.0, 0.0)], speed=speed) if walks else scene([near, (gap, 0.0, other)], speed=speed)
    )
    alone = scene([near], speed=speed)
    assert guarded(far, 0.0, acceleration, tc) == guarded(alone, 0.0, acceleration, tc)
    bound = sca(gap, 3.6 * speed, (0.0 if walks else other) - speed, tc)
    assert min(bound, stopping_bound(gap, speed, 0.0)) >= 2.0


# --- N worlds -------------------------------------------------------------------------------------------------


def random_worlds(n, seed=0):
    rng = np.random.default_rng(seed)
    world = empty_world(n, 4, 2)
    for name, low, high in (("d", -4.0, 4.0), ("speed", 0.0, 13.89), ("heading", -0.3, 0.3), ("target_d", -4.0, 4.0)):
        world.ego[name] = rng.uniform(low, high, n)
    world.ego["reference_d"] = world.ego["d"]
    world.ego["reference_speed"] = rng.uniform(-2.0, 2.0, n)
    world.vehicles["present"] = rng.random((n, 4)) < 0.8
    world.vehicles["s"] = rng.uniform(-60.0, 90.0, (n, 4))
    world.vehicles["d"] = rng.choice([-3.5, 0.0, 3.5], (n, 4))
    world.vehicles["speed"] = rng.uniform(0.0, 13.0, (n, 4))
    world.pedestrians["state"] = rng.integers(0, 3, (n, 2))
    world.pedestrians["s"] = rng.uniform(-5.0, 90.0, (n, 2))
    world.pedestrians["d"] = rng.uniform(-5.0, 5.0, (n, 2))
    world.pedestrians["lateral_speed"] = rng.uniform(-1.8, 1.8, (n, 2))
    return world, rng.uniform(-4.25, 4.25, n), rng.uniform(-2.0, 2.0, n)


def one_world(world, i):
    return World(*(part[i : i + 1] for part in (world.ego, world.vehicles, world.pedestrians, world.episode)))


def test_many_worlds_are_guarded_as_each_would_be_alone():
    world, targets, accelerations = random_worlds(60)
    together = SafetyGuard(3.0).filter(world, targets, accelerations)
    alone = SafetyGuard(3.0)
    assert 10 < together[2].sum() < 60
    for i in range(60):
        single = alone.filter(one_world(world, i), targets[i : i + 1], accelerations[i : i + 1])
        assert [part[0] for part in single] == [part[i] for part in together]


def test_the_filter_leaves_its_arguments_and_earlier_answers_alone():
    world, targets, accelerations = random_worlds(30)
    before = [part.tobytes() for part in (world.ego, world.vehicles, world.pedestrians, world.episode)]
    wishes = targets.tobytes(), accelerations.tobytes()
    guard = SafetyGuard(3.0)
    answer = guard.filter(world, targets, accelerations)
    kept = [part.copy() for part in answer]
    guard.filter(world, -targets, -accelerations)
    assert [p.tobytes() for p in (world.ego, world.vehicles, world.pedestrians, world.episode)] == before
    assert (targets.tobytes(), accelerations.tobytes()) == wishes
    for part, copy in zip(answer, kept, strict=True):
        assert np.array_equal(part, copy)


def test_limits_of_the_last_call_are_kept_for_every_world():
    world, targets, accelerations = random_worlds(7)
    guard = SafetyGuard(3.0)
    guard.filter(world, targets, accelerations)
    assert guard.limits.shape == (7, 2)


def test_options_reach_the_kernel_in_order():
    names = [field.name.removeprefix("literal_") for field in dataclasses.fields(GuardOptions)]
    printed = {"selection": "least_binding", "longitudinal": "printed_longitudinal"}
    assert list(Switches._fields) == [printed.get(name, name) for name in names]
    for field in dataclasses.fields(GuardOptions):
        flipped = dataclasses.replace(GuardOptions(), **{field.name: not field.default})
        assert sum(a != b for a, b in zip(dataclasses.astuple(flipped), SWITCHES, strict=True)) == 1

"""Alg. 2 in constructed states: limits in the lane, which body binds, and the braking reserve."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from algorithms.critical_acceleration import sca, stopping_bound
from algorithms.guard_options import GuardOptions
from algorithms.safety_guard import SafetyGuard
from tests.algorithms.guard_scenes import alongside, guarded, limits, scene

pytestmark = pytest.mark.kernels


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


def test_the_printed_selection_takes_a_car_alongside_for_nobody():
    # Alongside is -inf: the least a - Linear(IR), but no greatest a + Linear(IR), and so the set seems empty.
    world = alongside(2.0, 3.5)
    assert limits(world, target=3.5, literal_selection=True)[0] == math.inf
    assert guarded(world, target=3.5, literal_selection=True) == (3.5, 1.0, False)
    assert guarded(world, target=3.5) == (0.0, 1.0, True)


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

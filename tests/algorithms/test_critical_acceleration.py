"""Eq. (SCA) and the braking reserve: cases worked by hand, and what the formulas promise."""

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from algorithms.critical_acceleration import (
    CLEARANCE_M,
    follower_can_brake,
    sca,
    stopping_bound,
)

pytestmark = pytest.mark.kernels

SPEEDS = st.floats(0.0, 13.89)
HORIZONS = st.floats(0.5, 7.0)
GAPS = st.floats(0.01, 200.0)


@pytest.mark.parametrize(
    ("gap", "safe", "closing", "tc", "expected"),
    [
        # Ahead, inside the safe gap and closing in: 2 (30 - 36 + 3 * (-2)) / 3^2 = -24 / 9.
        (30.0, 36.0, -2.0, 3.0, -24.0 / 9.0),
        # Ahead, far away and drawing off: 2 (60 - 36 + 2 * 1) / 2^2 = 52 / 4.
        (60.0, 36.0, 1.0, 2.0, 13.0),
        # Behind, too near and catching up: 2 (-30 + 36 + 3 * 2) / 3^2 = 24 / 9: the ego is to speed up.
        (-30.0, 36.0, 2.0, 3.0, 24.0 / 9.0),
        # Behind, far away: 2 (-60 + 36 - 2 * 1) / 2^2 = -52 / 4: the ego may brake.
        (-60.0, 36.0, -1.0, 2.0, -13.0),
    ],
)
def test_critical_acceleration_by_hand(gap, safe, closing, tc, expected):
    assert sca(gap, safe, closing, tc) == pytest.approx(expected)


@given(GAPS, st.booleans(), SPEEDS, st.floats(-13.89, 13.89), HORIZONS)
def test_after_the_adjustment_time_the_gap_is_the_safe_one(gap, behind, speed, closing, tc):
    # Eq. (safe_dis_adj): under constant acceleration a the gap changes by closing * T_c - a T_c^2 / 2.
    sign = -1.0 if behind else 1.0
    safe = 3.6 * speed
    a = sca(sign * gap, safe, closing, tc)
    assert sign * gap + closing * tc - 0.5 * a * tc * tc == pytest.approx(sign * safe, abs=1e-9 * max(1.0, abs(a)))


@given(GAPS, SPEEDS, st.floats(-13.89, 13.89), HORIZONS)
def test_what_holds_ahead_holds_behind_with_the_sign_turned(gap, speed, closing, tc):
    assert sca(-gap, 3.6 * speed, -closing, tc) == -sca(gap, 3.6 * speed, closing, tc)


@given(GAPS, SPEEDS, st.floats(-13.89, 13.89), HORIZONS)
def test_a_shorter_adjustment_time_tightens_only_close_in(gap, speed, closing, tc):
    # da/dT_c = -(2 / T_c^3) (2 (gap - safe) + T_c closing): positive only where gap - safe < -T_c closing / 2.
    excess = gap - 3.6 * speed + 0.5 * tc * closing
    assume(abs(excess) > 1e-3)
    shorter, longer = sca(gap, 3.6 * speed, closing, tc * (1 - 1e-6)), sca(gap, 3.6 * speed, closing, tc)
    assert (shorter < longer) == (excess < 0.0)


def test_stopping_bound_by_hand():
    # 26.5 m behind a standing car at 10 m/s: 1 m stays free, 1 m is driven in this step, 24.5 m are left.
    # v' = 9.8 m/s stops within 9.8^2 / 4 + 9.8 / 20 = 24.01 + 0.49 = 24.5 m, so a = (9.8 - 10) / 0.1 = -2.
    assert stopping_bound(26.5, 10.0, 0.0) == pytest.approx(-2.0)
    # A leader at 12 m/s braking at 6 m/s2 adds 144 / 12 = 12 m of way: the same at a gap of 14.5 m.
    assert stopping_bound(14.5, 10.0, 12.0) == pytest.approx(-2.0)
    # v' = 10.2 m/s stops within 10.2^2 / 4 + 10.2 / 20 = 26.01 + 0.51 m: full throttle from 28.52 m on.
    assert stopping_bound(28.52, 10.0, 0.0) == pytest.approx(2.0)


def test_where_it_is_too_late_the_bound_still_tells_worse_from_bad():
    # Nothing left at 2 m: the bound is that of a stop within the step, -10 / 0.1; 1 m less lowers it by 1 / 0.01.
    assert stopping_bound(2.0, 10.0, 0.0) == pytest.approx(-100.0)
    assert stopping_bound(1.0, 10.0, 0.0) == pytest.approx(-200.0)


def stop_behind(gap, speed, leader, first):
    """Least gap if the ego takes `first` for a step and brakes at -2 m/s2, the leader at 6; steps as the engine's."""
    a, least = first, gap
    while speed > 0.0 or leader > 0.0:
        gap += 0.1 * (leader - speed)
        speed, leader, a = max(speed + 0.1 * a, 0.0), max(leader - 0.6, 0.0), -2.0
        least = min(least, gap)
    return least


@given(st.floats(1.0, 120.0), SPEEDS, SPEEDS)
def test_within_the_bound_the_ego_can_always_stop_behind_a_braking_leader(gap, speed, leader):
    bound = stopping_bound(gap, speed, leader)
    assume(bound >= -2.0)
    # The last step of braking begins below 0.2 m/s and leads on for 0.02 m at most.
    assert stop_behind(gap, speed, leader, min(bound, 2.0)) >= CLEARANCE_M - 0.02


@given(st.floats(-2.0, 1.5), st.floats(2.0, 13.5))
def test_beyond_the_bound_the_ego_can_not_stop_behind_a_standing_body(bound, speed):
    after = speed + 0.1 * bound
    gap = CLEARANCE_M + 0.1 * speed + after**2 / 4.0 + 0.05 * after
    assert stopping_bound(gap, speed, 0.0) == pytest.approx(bound, abs=1e-9)
    assert stop_behind(gap, speed, 0.0, bound + 0.5) < CLEARANCE_M - 0.02


@given(st.floats(0.0, 60.0), st.floats(0.01, 5.0), SPEEDS, SPEEDS)
def test_the_bound_grows_with_the_gap(gap, more, speed, leader):
    assert stopping_bound(gap + more, speed, leader) > stopping_bound(gap, speed, leader)


def test_a_follower_needs_room_to_react_and_to_brake():
    # 12^2 / 10 + 0.3 * 12 - 8^2 / 4 = 14.4 + 3.6 - 16 = 2 m, and 1 m clearance.
    assert follower_can_brake(3.01, 8.0, 12.0)
    assert not follower_can_brake(2.99, 8.0, 12.0)
    # 5^2 / 10 + 1.5 - 8^2 / 4 < 0: only the clearance.
    assert follower_can_brake(1.01, 8.0, 5.0)
    assert not follower_can_brake(0.99, 8.0, 5.0)


@given(st.floats(1.0, 60.0), SPEEDS, SPEEDS)
def test_a_follower_that_can_brake_stops_behind_an_ego_that_stops(gap, speed, follower):
    assume(follower_can_brake(gap, speed, follower))
    ego_way = speed**2 / 4.0
    assert gap + ego_way - (0.3 * follower + follower**2 / 10.0) >= CLEARANCE_M - 1e-9

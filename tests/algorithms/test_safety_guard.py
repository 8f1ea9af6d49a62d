"""The guard: Eq. (SCA) by hand, Alg. 2 in constructed states, and no contact whatever the actions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from algorithms.critical_acceleration import critical_acceleration, follower_can_brake, safe_gap, sca, stopping_bound
from algorithms.reference_drivers import RandomPolicy
from algorithms.safety_guard import GuardOptions, SafetyGuard, pedestrian_counts, require_horizon
from bench.stress import stress_guard
from envs.world import empty_world


def scene(gap=None, speed=10.0, other=10.0, d=0.0):
    """An ego in the middle lane and one car with a bumper gap ahead (or behind, if negative)."""
    world = empty_world(1, 1, 0)
    world.ego["speed"] = speed
    if gap is not None:
        world.vehicles["present"] = 1
        world.vehicles["s"] = gap + np.copysign(5.0, gap)
        world.vehicles["d"] = d
        world.vehicles["speed"] = other
    return world


def guarded(world, target=0.0, acceleration=1.0, tc=3.0, **options):
    targets, accelerations, flags, _ = SafetyGuard(tc, GuardOptions(**options)).filter(
        world, np.array([target]), np.array([acceleration])
    )
    return float(targets[0]), float(accelerations[0]), bool(flags[0])


def test_critical_acceleration_by_hand():
    # 2 (30 - 36 + 3 * (-2)) / 9 = -24 / 9; behind: 2 (-30 + 36 + 3 * 2) / 9 = 24 / 9.
    assert sca(30.0, 36.0, -2.0, 3.0) == pytest.approx(-24.0 / 9.0)
    assert sca(-30.0, 36.0, 2.0, 3.0) == pytest.approx(24.0 / 9.0)
    array = critical_acceleration(
        np.array([[30.0, -30.0, 0.0]]), safe_gap(np.array([[10.0]])), np.array([[-2.0, 2.0, 0.0]]), np.array([[3.0]])
    )
    assert array[0, :2] == pytest.approx([-24.0 / 9.0, 24.0 / 9.0])
    assert array[0, 2] == -np.inf


@pytest.mark.parametrize("tc", [0.0, -1.0, float("nan"), float("inf")])
def test_an_unusable_adjustment_time_is_named(tc):
    with pytest.raises(ValueError, match="T_c"):
        require_horizon(tc)
    with pytest.raises(ValueError, match="T_c"):
        critical_acceleration(np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.array([[tc]]))


@given(st.floats(1.5, 80.0), st.floats(0.0, 13.89), st.floats(0.0, 13.89))
def test_braking_keeps_the_reserve_that_the_bound_promises(gap, speed, leader):
    if stopping_bound(gap, speed, leader) < -2.0:
        return
    next_speed = max(speed - 0.2, 0.0)
    next_leader = max(leader - 0.6, 0.0)
    next_gap = gap + 0.1 * (0.5 * (leader + next_leader) - speed)
    if next_speed > 0.0 and next_leader > 0.0:
        assert stopping_bound(next_gap, next_speed, next_leader) >= -2.0 - 1e-6


def test_a_follower_needs_room_to_brake():
    # 12^2 / 10 + 0.3 * 12 - 8^2 / 4 = 2.0 m, and 1 m clearance.
    assert follower_can_brake(3.01, 8.0, 12.0)
    assert not follower_can_brake(2.99, 8.0, 12.0)


def test_an_empty_world_passes_the_action_through():
    assert guarded(scene(), target=3.5, acceleration=1.7) == (3.5, 1.7, False)


def test_the_leader_limits_the_acceleration_to_the_critical_one():
    # Gap 34 m, S_safe 36 m, equal speeds, T_c 3 s: 2 (-2) / 9.
    assert guarded(scene(34.0)) == (0.0, pytest.approx(-4.0 / 9.0), True)
    assert guarded(scene(34.0), acceleration=-1.0) == (0.0, -1.0, False)
    assert guarded(scene(80.0)) == (0.0, 1.0, False)


def test_a_car_in_another_lane_counts_only_in_the_literal_reading():
    assert guarded(scene(20.0, d=3.5)) == (0.0, 1.0, False)
    assert guarded(scene(20.0, d=3.5), literal_all_lanes=True)[2]


def test_a_lane_change_into_a_car_alongside_or_a_fast_follower_is_refused():
    assert guarded(scene(-2.0, d=3.5), target=3.5)[0] == 0.0
    assert guarded(scene(-8.0, other=13.0, d=3.5), target=3.5)[0] == 0.0
    assert guarded(scene(-60.0, other=8.0, d=3.5), target=3.5)[0] == 3.5


def test_a_follower_in_the_own_lane_counts_only_in_the_literal_reading():
    assert guarded(scene(-34.0), acceleration=0.0) == (0.0, 0.0, False)
    assert guarded(scene(-34.0), acceleration=0.0, literal_followers=True) == (0.0, pytest.approx(4.0 / 9.0), True)


def test_the_printed_longitudinal_rule_jumps_to_the_upper_limit():
    # Behind: a_follow = 4/9; ahead nothing binds: the printed rule takes a_pre, clipped to 2.
    world = scene(-34.0)
    kwargs = {"acceleration": 0.0, "literal_followers": True}
    assert guarded(world, **kwargs)[1] == pytest.approx(4.0 / 9.0)
    assert guarded(world, **kwargs, literal_longitudinal=True)[1] == 2.0


def test_the_reserve_brakes_where_a_long_adjustment_time_would_not():
    # 5 m before a standing car at 4 m/s: a_pre = 2 (5 - 14.4 - 28) / 49 = -1.53, but 4 m to stop in and 1 m clearance.
    assert guarded(scene(5.0, 4.0, 0.0), tc=7.0, reserve=False)[1] == pytest.approx(-1.527, abs=1e-3)
    assert guarded(scene(5.0, 4.0, 0.0), tc=7.0)[1] == -2.0


def test_a_pedestrian_counts_until_he_has_surely_left():
    # He leaves the strip [-1.3, 1.3] m at 1.6 m after 1.2 / 1 s and 0.3 s margin; at 10 m/s the ego needs 1.87 s for
    # 22.2 m at full throttle.
    assert not pedestrian_counts(22.2, 0.4, 1.0, -1.3, 1.3, 10.0)
    assert pedestrian_counts(15.0, 0.4, 1.0, -1.3, 1.3, 10.0)
    assert not pedestrian_counts(5.0, 1.7, 1.0, -1.3, 1.3, 10.0)


def test_the_filter_leaves_its_arguments_alone():
    world, targets, accelerations = scene(20.0), np.array([0.5]), np.array([2.0])
    before = world.copy()
    SafetyGuard(3.0).filter(world, targets, accelerations)
    assert (targets[0], accelerations[0]) == (0.5, 2.0)
    assert before.ego.tobytes() == world.ego.tobytes()
    assert before.vehicles.tobytes() == world.vehicles.tobytes()


@pytest.mark.parametrize("scenario", ["a", "b"])
@pytest.mark.parametrize("tc", [0.5, 3.0, 7.0])
def test_random_actions_behind_the_guard_touch_nobody(scenario, tc):
    result = stress_guard(scenario, tc, 300, "random")
    assert result.episodes == 300
    assert result.collisions == 0
    assert 0.0 < result.intervention_ratio < 0.5


def test_random_actions_without_the_guard_do():
    from bench.evaluate import evaluate
    from envs.scenario import get_scenario

    assert (evaluate(RandomPolicy(), get_scenario("a"), 256, 256)["fault"] > 0).mean() > 0.3

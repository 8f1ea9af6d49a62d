"""The corridor that the guard keeps free: turned bodies, the excursion of a motion, its extent and reach."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from algorithms.corridor import corridor, lateral_extent, lateral_response, reach
from algorithms.critical_acceleration import sca, stopping_bound
from envs.motion import plan_lateral
from tests.algorithms.guard_scenes import SWITCHES, alongside, guarded, scene

pytestmark = pytest.mark.kernels


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

"""Car following: IDM by hand, who follows whom, and what a follower takes from its leader."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.traffic import NOBODY, following_acceleration, idm_acceleration, judged_acceleration, neighbour, not_zero
from envs.world import CROSSING, GONE, WAITING, World
from tests.envs.small_worlds import FAR_BEHIND, one_world, people

kernels = pytest.mark.kernels
SPEEDS = st.floats(0.0, 14.0)
BRAKING_ROOT = math.sqrt(3.0 * 5.0)


@kernels
@pytest.mark.parametrize(
    ("x", "expected"), [(2.0, 2.0), (-2.0, -2.0), (0.0, 0.01), (0.01, 0.01), (-0.001, -0.01), (0.002, 0.01)]
)
def test_not_zero_keeps_a_hundredth_from_zero_and_the_sign(x: float, expected: float) -> None:
    assert not_zero(x) == expected


@kernels
@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        # Free road at half the desired speed: 3 (1 - 0.5^4), with exponent 2: 3 (1 - 0.5^2).
        ((6.0, 12.0, 4.0, 1.5, math.inf, 0.0), 2.8125),
        ((6.0, 12.0, 2.0, 1.5, math.inf, 0.0), 2.25),
        ((12.0, 12.0, 4.0, 1.5, math.inf, 0.0), 0.0),
        ((14.0, 10.0, 4.0, 1.5, math.inf, 0.0), 3.0 * (1.0 - 1.4**4)),
        # At the desired speed the free part is 0. Desired gap 10 + 15 + 10 x 2 / (2 sqrt 15) = 27.58199 m,
        # so -3 (27.58199 / 40)^2.
        ((10.0, 10.0, 4.0, 1.5, 40.0, 2.0), -1.426437),
        # An opening gap wants less: 25 - 2.58199 = 22.41801 m.
        ((10.0, 10.0, 4.0, 1.5, 40.0, -2.0), -0.942314),
        # Headway 1 s: 10 + 10 = 20 m at equal speeds, -3 (20 / 40)^2.
        ((10.0, 10.0, 4.0, 1.0, 40.0, 0.0), -0.75),
        # At rest 12 m behind a standing car: 3 - 3 (10 / 12)^2.
        ((0.0, 10.0, 4.0, 1.5, 12.0, 0.0), 3.0 - 3.0 * 100.0 / 144.0),
        # A gap of 0 counts as 0.01 m, a desired speed of 0 as 0.01 m/s.
        ((0.0, 10.0, 4.0, 1.5, 0.0, 0.0), 3.0 - 3.0e6),
        ((0.02, 0.0, 4.0, 1.5, math.inf, 0.0), 3.0 * (1.0 - 16.0)),
    ],
)
def test_idm_by_hand(arguments: tuple[float, ...], expected: float) -> None:
    assert idm_acceleration(*arguments) == pytest.approx(expected, rel=1e-6)


@kernels
@given(SPEEDS, st.floats(5.0, 14.0), st.floats(6.0, 200.0), st.floats(-5.0, 10.0), st.floats(0.1, 50.0))
def test_idm_asks_for_less_when_the_leader_is_nearer_or_slower(
    speed: float, desired: float, gap: float, closing: float, more: float
) -> None:
    a = idm_acceleration(speed, desired, 4.0, 1.5, gap, closing)
    wanted = 10.0 + 1.5 * speed + speed * closing / (2.0 * BRAKING_ROOT)
    if wanted > 0.0:  # highway-env squares the desired gap even where it is negative
        assert idm_acceleration(speed, desired, 4.0, 1.5, gap + more, closing) >= a
        assert idm_acceleration(speed, desired, 4.0, 1.5, gap, closing + more) <= a
    assert idm_acceleration(speed, desired, 4.0, 1.5, math.inf, 0.0) >= a
    assert idm_acceleration(speed, desired + more, 4.0, 1.5, gap, closing) >= a


@kernels
def test_neighbours_are_the_nearest_present_bodies_of_the_lane() -> None:
    world = one_world(
        {"s": 0.0},
        [
            {"s": 50.0, "d": 0.0},
            {"s": 30.0, "d": 3.5},  # another lane
            {"s": 20.0, "d": 0.0, "present": 0},
            {"s": 60.0, "d": 2.7},  # within 1 m of the lane's edge: counts for both lanes
            {"s": -9.0, "d": 0.0},
        ],
        [people(WAITING, 10.0), people(CROSSING, 40.0, -2.74), people(GONE, 5.0)],
    )
    w = (world.ego, world.vehicles, world.pedestrians)
    ego, vehicle = 0, 1
    crossing = 1 + 5 + 1
    assert [neighbour(*w, 0, ego, 1, ahead) for ahead in (True, False)] == [crossing, 5]
    assert [neighbour(*w, 0, ego, 2, ahead) for ahead in (True, False)] == [2, NOBODY]
    assert [neighbour(*w, 0, vehicle, 1, ahead) for ahead in (True, False)] == [4, crossing]
    assert [neighbour(*w, 0, 5, 1, ahead) for ahead in (True, False)] == [ego, NOBODY]
    assert [neighbour(*w, 0, vehicle, 2, ahead) for ahead in (True, False)] == [4, 2]


@kernels
@pytest.mark.parametrize(("d", "seen"), [(2.75, True), (2.7500001, False), (-2.75, True), (-2.7500001, False)])
def test_a_body_counts_on_a_lane_up_to_a_metre_beyond_its_edge(d: float, seen: bool) -> None:
    world = one_world({"s": 0.0}, [{"s": 30.0, "d": d}])
    ahead = neighbour(world.ego, world.vehicles, world.pedestrians, 0, 0, 1, True)
    assert (ahead == 1) is seen


@kernels
def test_a_body_at_the_same_position_is_ahead() -> None:
    world = one_world({"s": 5.0}, [{"s": 5.0}])
    w = (world.ego, world.vehicles, world.pedestrians)
    assert [neighbour(*w, 0, 0, 1, ahead) for ahead in (True, False)] == [1, NOBODY]
    assert [neighbour(*w, 0, 1, 1, ahead) for ahead in (True, False)] == [0, NOBODY]


def follow(world: World, k: int, leader: int) -> float:
    return float(following_acceleration(world.ego, world.vehicles, world.pedestrians, 0, k, leader))


@kernels
def test_followers_take_gap_and_closing_speed_from_their_leader() -> None:
    world = one_world({"s": 0.0, "speed": 13.89}, [{"s": 40.0, "speed": 8.0}, {"s": 80.0, "speed": 6.0}])
    assert follow(world, 1, 2) == pytest.approx(idm_acceleration(8.0, 8.0, 4.0, 1.5, 40.0, 2.0))
    # MOBIL sees the ego as a driver who wants v_max.
    assert follow(world, 0, 1) == pytest.approx(idm_acceleration(13.89, 13.89, 4.0, 1.5, 40.0, 5.89))
    assert follow(world, 2, NOBODY) == pytest.approx(0.0)
    assert follow(world, NOBODY, 1) == 0.0


@kernels
def test_a_crossing_pedestrian_stands_still_along_the_road() -> None:
    world = one_world(FAR_BEHIND, [{"s": 0.0, "speed": 10.0}], [people(CROSSING, 40.0)])
    assert follow(world, 1, 2) == pytest.approx(idm_acceleration(10.0, 10.0, 4.0, 1.5, 40.0, 10.0))
    assert follow(world, 2, NOBODY) == 0.0


@kernels
def test_a_leader_who_turns_away_counts_with_its_speed_along_the_own_heading() -> None:
    follower, leader = {"s": 0.0, "speed": 10.0, "heading": 0.1}, {"s": 40.0, "speed": 8.0, "heading": 0.4}
    world = one_world(FAR_BEHIND, [follower, leader])
    closing = 10.0 - 8.0 * math.cos(0.3)
    assert follow(world, 1, 2) == pytest.approx(idm_acceleration(10.0, 10.0, 4.0, 1.5, 40.0, closing))


@kernels
def test_a_judged_follower_keeps_its_desired_speed_and_takes_the_judges_headway_and_exponent() -> None:
    judge = {"s": 40.0, "speed": 8.0, "headway": 1.0, "exponent": 2.0}
    world = one_world(FAR_BEHIND, [{"s": 0.0, "speed": 10.0, "desired_speed": 12.0}, judge])
    imposed = judged_acceleration(world.ego, world.vehicles, world.pedestrians, 0, 2, 1, 2)
    assert imposed == pytest.approx(idm_acceleration(10.0, 12.0, 2.0, 1.0, 40.0, 2.0))
    assert follow(world, 1, 2) == pytest.approx(idm_acceleration(10.0, 12.0, 4.0, 1.5, 40.0, 2.0))

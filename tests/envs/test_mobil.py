"""MOBIL: for which gain a car changes lane, whom it may hinder, when it decides and when it gives way."""

from typing import Any

import pytest

from envs.traffic import decide_lane
from tests.envs.small_worlds import FAR_BEHIND, one_world

kernels = pytest.mark.kernels


def chosen_lane(vehicles: list[dict[str, Any]], j: int = 0, ego: dict[str, float] | None = None) -> int:
    """Target lane of vehicle j once its timer has run out."""
    vehicles[j].setdefault("timer", 1.05)
    world = one_world(ego or FAR_BEHIND, vehicles)
    decide_lane(world.ego, world.vehicles, world.pedestrians, 0, j)
    return int(world.vehicles.target_lane[0, j])


def slow_leader(d: float = 0.0, **fields: float) -> list[dict[str, Any]]:
    """A car at 10 m/s, 30 m behind one at 6 m/s."""
    return [{"s": 0.0, "d": d, "speed": 10.0, **fields}, {"s": 30.0, "d": d, "speed": 6.0}]


@kernels
def test_mobil_leaves_a_slow_leader_for_a_free_lane_on_either_side() -> None:
    assert chosen_lane(slow_leader(d=-3.5)) == 1
    assert chosen_lane(slow_leader(d=3.5)) == 1
    assert chosen_lane(slow_leader()) == 2  # both would do; the later candidate stays
    assert chosen_lane([*slow_leader(), {"s": 30.0, "d": 3.5, "speed": 6.0}]) == 0


@kernels
def test_mobil_stays_on_a_free_lane() -> None:
    assert chosen_lane([{"s": 0.0, "speed": 10.0}]) == 1


@kernels
@pytest.mark.parametrize(("gap", "lane"), [(53.0, 2), (54.0, 1)])
def test_mobil_changes_for_a_gain_of_at_least_a_fifth(gap: float, lane: int) -> None:
    # Everybody at 8 m/s, as desired: a desired gap of 22 m, so a leader costs 3 (22 / gap)^2. The own one 0.5169 at
    # 53 m and 0.4979 at 54 m, the left one 0.3006 at 69.5 m: gains of 0.2163 and 0.1973. The right one gains nothing.
    gain = 3.0 * (22.0 / gap) ** 2 - 3.0 * (22.0 / 69.5) ** 2
    assert (gain >= 0.2) is (lane == 2)
    cars = [{"s": 0.0, "speed": 8.0}, {"s": gap, "speed": 8.0}]
    sides = [{"s": 69.5, "d": 3.5, "speed": 8.0}, {"s": 53.5, "d": -3.5, "speed": 8.0}]
    assert chosen_lane([*cars, *sides]) == lane


@kernels
@pytest.mark.parametrize(("behind", "lane"), [(31.0, 1), (33.0, 2)])
def test_mobil_imposes_no_more_than_2_mps2_on_the_new_follower(behind: float, lane: int) -> None:
    # The follower at 12 m/s, 2 m/s faster, wants 13: the free road gives it 3 (1 - (12 / 13)^4) = 0.822 m/s2. Desired
    # gap 10 + 18 + 24 / (2 sqrt 15) = 31.098 m, so it brakes at 2 m/s2 where 3 (31.098 / gap)^2 = 2.822: at 32.06 m.
    follower = {"s": -behind, "d": 3.5, "speed": 12.0, "desired_speed": 13.0}
    blocked = {"s": 30.0, "d": -3.5, "speed": 6.0}
    assert chosen_lane([*slow_leader(), blocked, follower]) == lane


@kernels
def test_mobil_counts_the_ego_as_a_follower_who_wants_50_kmh() -> None:
    blocked = {"s": 30.0, "d": -3.5, "speed": 6.0}
    near, far = ({"s": s, "d": 3.5, "speed": 10.0} for s in (-15.0, -40.0))
    assert chosen_lane([*slow_leader(), blocked], ego=near) == 1
    assert chosen_lane([*slow_leader(), blocked], ego=far) == 2


@kernels
@pytest.mark.parametrize(("fields", "lane"), [({"timer": 1.0}, 1), ({"timer": 1.05}, 2), ({"speed": 0.9}, 1)])
def test_mobil_decides_once_a_second_and_only_on_the_move(fields: dict[str, float], lane: int) -> None:
    assert chosen_lane(slow_leader(**fields)) == lane


@kernels
def test_a_decision_starts_the_timer_again_whatever_it_is() -> None:
    world = one_world(FAR_BEHIND, [{"s": 0.0, "speed": 10.0, "timer": 1.05}])
    decide_lane(world.ego, world.vehicles, world.pedestrians, 0, 0)
    assert world.vehicles.timer[0, 0] == 0.0


@kernels
@pytest.mark.parametrize(
    ("other", "lane"),
    [
        ({"s": 20.0, "d": 3.5}, 0),  # also on its way into the middle, within the desired gap: give way
        ({"s": 20.0, "d": 3.5, "target_lane": 2}, 1),  # keeps its lane
        ({"s": -20.0, "d": 3.5}, 1),  # behind
        ({"s": 60.0, "d": 3.5}, 1),  # beyond the desired gap of 10 + 15 m
        ({"s": 20.0, "d": 0.0}, 1),  # in the middle already
        ({"s": 20.0, "d": 3.5, "present": 0}, 1),
        # 26 m ahead, 2 m/s slower: the desired gap grows by 20 / (2 sqrt 15) = 2.58 m to 27.58 m.
        ({"s": 26.0, "d": 3.5, "speed": 8.0}, 0),
        ({"s": 26.0, "d": 3.5, "speed": 10.0}, 1),
    ],
)
def test_a_lane_change_is_given_up_for_a_car_ahead_that_changes_into_the_same_lane(
    other: dict[str, float], lane: int
) -> None:
    changing = {"s": 0.0, "d": -3.5, "speed": 10.0, "target_lane": 1}
    assert chosen_lane([changing, {"target_lane": 1, "speed": 10.0, **other}]) == lane


@kernels
def test_who_gives_way_reckons_with_the_others_speed_along_the_own_heading() -> None:
    # Parallel at 0.5 rad, 8 against 10 m/s: the desired gap is 27.58 m, as above, and 30 m are enough.
    changing = {"s": 0.0, "d": -3.5, "speed": 10.0, "heading": 0.5, "target_lane": 1}
    other = {"s": 30.0, "d": 3.5, "speed": 8.0, "heading": 0.5, "target_lane": 1}
    assert chosen_lane([changing, other]) == 1
    assert chosen_lane([changing, {**other, "s": 27.0}]) == 0

"""Contact with cars and pedestrians: true overlap, and whose fault it is."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.engine import find_contact, judge_contact
from envs.traffic import move
from envs.world import CROSSING, GONE, Ending, Fault, World
from tests.envs.small_worlds import Fields, advance, one_world

kernels = pytest.mark.kernels


@kernels
@pytest.mark.parametrize(
    ("ds", "dd", "ego_lateral", "other_lateral", "fault", "at_fault"),
    [
        # In the same lane the car ahead is always the ego's fault, the one behind only if the ego moved sideways.
        (5.1, 0.0, 0.0, 0.0, Fault.AHEAD, 1),
        (5.1, -1.9999, 0.0, -2.0, Fault.AHEAD, 1),
        (-5.1, 0.0, 0.0, 0.0, Fault.REAR_ENDED, 0),
        (-5.1, 0.5, 0.1, 0.0, Fault.REAR_ENDED, 0),
        (-5.1, 0.5, -0.1001, 0.0, Fault.REAR_ENDED, 1),
        # Beside each other: whoever moves sideways faster; the ego only if it moves at all.
        (1.0, 2.0, 0.5, 0.0, Fault.SIDE, 1),
        (-4.9999, -2.1, -0.5, 0.0, Fault.SIDE, 1),
        (1.0, 2.1, 0.0, -0.5, Fault.SIDE, 0),
        (1.0, 2.1, 0.5, -0.5, Fault.SIDE, 1),
        (1.0, 2.1, 0.4, -0.5, Fault.SIDE, 0),
        (1.0, 2.1, 0.09, 0.0, Fault.SIDE, 0),
        # Corner to corner: neither beside nor in line; front or rear decides.
        (5.0, 2.1, 0.5, 0.0, Fault.AHEAD, 1),
        (-5.0, 2.1, 0.0, -0.5, Fault.REAR_ENDED, 0),
    ],
)
def test_fault_is_judged_from_the_step_before_contact(
    ds: float, dd: float, ego_lateral: float, other_lateral: float, fault: Fault, at_fault: int
) -> None:
    assert judge_contact(ds, dd, ego_lateral, other_lateral) == (fault, at_fault)


def collide(ego: Fields, other: Fields, **arguments: float) -> World:
    """Advance the ego beside or behind one car by a step."""
    world = one_world(ego, [other])
    advance(world, **arguments)  # type: ignore[arg-type]
    return world


@kernels
def test_running_into_a_car_ahead_is_the_egos_fault() -> None:
    world = collide({"s": 0.0, "speed": 10.0}, {"s": 5.5, "speed": 1.0})
    episode = world.episode[0]
    assert (episode.ending, episode.fault, episode.ego_at_fault) == (Ending.COLLISION, Fault.AHEAD, 1)


@kernels
def test_being_hit_from_behind_is_not() -> None:
    world = collide({"s": 0.0, "speed": 1.0}, {"s": -5.5, "speed": 12.0})
    episode = world.episode[0]
    assert (episode.ending, episode.fault, episode.ego_at_fault) == (Ending.COLLISION, Fault.REAR_ENDED, 0)


@kernels
def test_swerving_into_a_car_alongside_is_the_egos_fault() -> None:
    ego = {"speed": 10.0, "d": 1.49, "heading": 0.2, "reference_speed": 2.0}
    world = collide(ego, {"s": 1.0, "d": 3.5, "speed": 10.0}, target=3.5)
    assert world.ego.lateral_speed[0] > 0.0
    episode = world.episode[0]
    assert (episode.ending, episode.fault, episode.ego_at_fault) == (Ending.COLLISION, Fault.SIDE, 1)


@kernels
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_car_that_turns_into_the_egos_lane_is_at_fault_itself(side: float) -> None:
    # Half a metre further in its last step: beside the ego before it, overlapping after it.
    other = {"s": 1.0, "d": side * 2.1, "speed": 10.0, "heading": -side * 0.3}
    world = one_world({"speed": 10.0}, [{**other, "target_lane": 1, "timer": 0.0}])
    advance(world, lane_changes=True)
    episode = world.episode[0]
    assert (episode.ending, episode.fault, episode.ego_at_fault) == (Ending.COLLISION, Fault.SIDE, 0)


NEAR = 1e-7


@kernels
@given(
    st.tuples(st.floats(-500, 500), st.floats(-3, 3), st.floats(2, 13), st.floats(-0.3, 0.3)),
    st.floats(-3.0, 3.0),
    st.floats(-0.1, 0.1),
)
def test_fault_is_judged_from_where_the_other_car_really_was(
    start: tuple[float, float, float, float], acceleration: float, steering: float
) -> None:
    s, d, speed, heading = start
    car = {"s": s, "d": d, "speed": speed, "heading": heading, "acceleration": acceleration, "steering": steering}
    world = one_world({}, [car])
    move(world.vehicles, 0, True)
    lateral_speed = (float(world.vehicles.d[0, 0]) - d) / 0.1
    for name in ("s", "d", "heading"):
        world.ego[name][0] = world.vehicles[name][0, 0]  # in contact now

    def judge(ds: float, dd: float, ego_lateral_speed: float) -> tuple[int, int]:
        """With the ego that far before the other car, a step ago."""
        world.ego.lateral_speed[0] = ego_lateral_speed
        return find_contact(world.ego, world.vehicles, world.pedestrians, 0, s - ds, d - dd)

    still = 0.0
    assert judge(5.0 + NEAR, 2.5, still)[0] == judge(NEAR, 1.0, still)[0] == Fault.AHEAD
    assert judge(5.0 - NEAR, 2.5, still)[0] == judge(1.0, 2.0 + NEAR, still)[0] == Fault.SIDE
    assert judge(-5.0 + NEAR, -2.5, still)[0] == judge(1.0, -2.0 - NEAR, still)[0] == Fault.SIDE
    assert judge(1.0, 2.0 - NEAR, still)[0] == judge(1.0, -2.0 + NEAR, still)[0] == Fault.AHEAD
    assert judge(-NEAR, 1.0, still)[0] == judge(-5.0 - NEAR, 2.5, still)[0] == Fault.REAR_ENDED
    if abs(lateral_speed) > 0.11:
        assert judge(1.0, 2.5, abs(lateral_speed) + NEAR) == (Fault.SIDE, 1)
        assert judge(1.0, 2.5, abs(lateral_speed) - NEAR) == (Fault.SIDE, 0)


@kernels
@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("ds", "dd", "hit"),
    [(0.0, 1.3 - 1e-6, True), (0.0, 1.3 + 1e-6, False), (2.8 - 1e-6, 0.0, True), (2.8 + 1e-6, 0.0, False)],
)
def test_contact_with_a_pedestrian_is_true_overlap_and_the_egos_fault(
    ds: float, dd: float, hit: bool, side: float
) -> None:
    crossing = {"state": CROSSING, "s": 300.0 + side * ds, "d": 1.5 + side * dd}
    world = one_world({"s": 300.0, "d": 1.5}, [], [crossing, {"state": GONE, "s": 300.0, "d": 1.5}])
    found = find_contact(world.ego, world.vehicles, world.pedestrians, 0, 299.0, 1.5)
    assert found == ((Fault.PEDESTRIAN, 1) if hit else (Fault.NONE, 0))


@kernels
def test_contact_with_a_pedestrian_minds_the_egos_heading() -> None:
    # Turned by 30 degrees the ego reaches 2.5 sin 30 + 1.0 cos 30 = 2.116 m to its left at its front corner, which
    # lies 2.5 cos 30 - 1.0 sin 30 = 1.665 m ahead.
    for dd, hit in ((2.116 + 0.29, True), (2.116 + 0.31, False)):
        world = one_world({"heading": math.radians(30.0)}, [], [{"state": CROSSING, "s": 1.665, "d": dd}])
        found = find_contact(world.ego, world.vehicles, world.pedestrians, 0, 0.0, 0.0)
        assert found[0] == (Fault.PEDESTRIAN if hit else Fault.NONE)


@kernels
def test_absent_cars_cannot_be_hit() -> None:
    world = one_world({}, [{"s": 0.0, "present": 0}])
    assert find_contact(world.ego, world.vehicles, world.pedestrians, 0, 0.0, 0.0) == (Fault.NONE, 0)


@kernels
def test_predicted_overlap_is_no_collision() -> None:
    # 5.05 m apart after the step and closing at 9 m/s: highway-env's own flag would be raised already.
    world = collide({"s": 0.0, "speed": 10.0}, {"s": 5.95, "speed": 1.0, "desired_speed": 1.0})
    assert world.vehicles.s[0, 0] - world.ego.s[0] == pytest.approx(5.05)
    assert world.episode.ending[0] == Ending.RUNNING

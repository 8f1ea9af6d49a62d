"""What surrounds the steps of a decision: actions in, rewards and endings out, next episodes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.batch import VALID, conclude, interpret_actions, load_episodes, observe
from envs.driving_env import ActionMode, action_space
from envs.layout import sample_initial_worlds
from envs.motion import HORIZON_S, TARGET_MAX_M
from envs.observation import OBSERVATION_SIZE, write_observation
from envs.scenario import get_scenario
from envs.world import Ending, empty_world
from tests.envs.small_worlds import one_world, readable

pytestmark = pytest.mark.kernels

LANE_CENTRES = np.array([-3.5, 0.0, 3.5])


def interpret(d: list[float], actions: list[list[float]], mode: ActionMode) -> tuple[int, np.ndarray]:
    """Return value and targets, commands, horizons, speeds, shape (4, N)."""
    world = readable(empty_world(len(d), 1, 0))
    world.ego["d"] = d
    box = action_space(mode)
    low, high = box.low.astype(np.float64), box.high.astype(np.float64)
    out = np.full((4, len(d)), np.nan)
    bad = interpret_actions(world.ego, np.array(actions), low, high, mode is ActionMode.PLANNING, *out)
    return int(bad), out


def test_actions_of_the_agent_by_hand() -> None:
    bad, out = interpret([0.3, -3.0, 3.6], [[1.0, 0.5], [-2.0, -9.0], [9.0, 2.0]], ActionMode.ACCELERATION)
    assert bad == VALID
    # Offsets from the nearest centre, clipped to 3.5 m and then to the road; accelerations clipped to 2 m/s2.
    assert out[0].tolist() == pytest.approx([1.0, -4.25, 4.25])
    assert out[1].tolist() == pytest.approx([0.5, -2.0, 2.0])
    assert out[2].tolist() == [HORIZON_S] * 3
    assert out[3].tolist() == [0.0] * 3


def test_actions_of_the_driving_agent_by_hand() -> None:
    plans = [[0.1, 1.0, 11.0], [9.0, -1.0, -3.0], [2.0, 0.0, 99.0]]
    bad, out = interpret([0.0, 3.5, -3.5], plans, ActionMode.PLANNING)
    assert bad == VALID
    assert out[0].tolist() == pytest.approx([1.0, 2.5, -3.5])
    assert out[1].tolist() == [0.0] * 3
    assert out[2].tolist() == pytest.approx([0.5, 4.0, 2.0])
    assert out[3].tolist() == pytest.approx([11.0, 0.0, 13.89])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("mode", "entries"), [(ActionMode.ACCELERATION, 2), (ActionMode.PLANNING, 3)])
def test_the_first_entry_that_is_not_finite_is_named(mode: ActionMode, entries: int, value: float) -> None:
    assert VALID < 0
    for place in range(3 * entries):
        actions = np.ones(3 * entries)
        actions[place:] = value
        assert interpret([0.0] * 3, actions.reshape(3, entries).tolist(), mode)[0] == place


@given(st.floats(-5.25, 5.25), st.floats(-3.5, 3.5), st.floats(-2.0, 2.0))
def test_a_target_is_as_far_from_a_nearest_centre_as_asked_or_at_the_edge(d: float, offset: float, a: float) -> None:
    _, ((target,), (command,), _, _) = interpret([d], [[offset, a]], ActionMode.ACCELERATION)
    distances = np.abs(d - LANE_CENTRES)
    nearest = LANE_CENTRES[distances <= distances.min() + 1e-9]
    assert np.isclose(target, np.clip(nearest + offset, -TARGET_MAX_M, TARGET_MAX_M)).any()
    assert command == pytest.approx(a)


def concluded(endings: list[int], active: list[bool], comfort: bool) -> tuple[int, list[np.ndarray]]:
    """A decision of five steps in worlds with sums 10, -1, -5, 2 (times 1, 2, ...) and 3 interventions more."""
    n = len(endings)
    world = readable(empty_world(n, 1, 0))
    world.episode["ending"] = endings
    world.episode["interventions"] = 10
    sums = np.outer(np.arange(1, n + 1), [10.0, -1.0, -5.0, 2.0])
    before = np.full(n, 7)
    out = [np.empty(n), np.empty(n), np.empty(n), np.empty(n, np.int64), np.empty(n, np.bool_), np.empty(n, np.bool_)]
    ended = conclude(world.episode, np.array(active), before, sums, 5, comfort, *out)
    assert before.tolist() == [10] * n
    return int(ended), out


def test_rewards_are_means_and_costs_are_sums_by_hand() -> None:
    ended, (reward, without_risk, cost, intervened, _, _) = concluded([0, 0], [True, True], comfort=True)
    assert ended == 0
    assert reward.tolist() == pytest.approx([4.0 / 5.0, 8.0 / 5.0])
    assert without_risk.tolist() == pytest.approx([9.0 / 5.0, 18.0 / 5.0])
    assert cost.tolist() == [2.0, 4.0]
    assert intervened.tolist() == [3, 3]
    _, (reward, without_risk, *_) = concluded([0], [True], comfort=False)
    assert (reward[0], without_risk[0]) == pytest.approx((1.0, 2.0))


def test_collision_and_off_road_terminate_goal_and_time_limit_truncate() -> None:
    endings = [Ending.RUNNING, Ending.GOAL, Ending.COLLISION, Ending.OFF_ROAD, Ending.TIME_OUT]
    ended, out = concluded([int(e) for e in endings], [True] * 5, comfort=True)
    assert ended == 4
    assert out[4].tolist() == [False, False, True, True, False]
    assert out[5].tolist() == [False, True, False, False, True]
    ended, out = concluded([int(e) for e in endings], [False] * 5, comfort=True)
    assert ended == 0
    assert not (out[4] | out[5]).any()


def test_episodes_are_loaded_into_the_named_worlds_in_order() -> None:
    start = sample_initial_worlds(get_scenario("b"), np.random.SeedSequence(1), 6)
    start.episode["episode"] = np.arange(100, 106)
    world = readable(empty_world(4, 5, 3))
    active, before = np.zeros(4, np.bool_), np.full(4, 9)
    load_episodes(
        world.ego, world.vehicles, world.pedestrians, world.episode, active, before, np.array([3, 1]),
        start.ego, start.vehicles, start.pedestrians, start.episode, 2,
    )  # fmt: skip
    assert world.episode["episode"].tolist() == [0, 103, 0, 102]
    for i, row in ((3, 2), (1, 3)):
        assert world.ego[i].tobytes() == start.ego[row].tobytes()
        assert world.vehicles[i].tobytes() == start.vehicles[row].tobytes()
        assert world.pedestrians[i].tobytes() == start.pedestrians[row].tobytes()
    assert active.tolist() == [False, True, False, True]
    assert before.tolist() == [9, 0, 9, 0]


def test_inactive_worlds_are_observed_as_zeros_and_others_are_left_alone() -> None:
    world = one_world({"s": 100.0, "speed": 8.0}, [{"s": 130.0}])
    row = np.empty(OBSERVATION_SIZE, np.float32)
    write_observation(world.ego, world.vehicles, world.pedestrians, 0, row, np.empty(8, np.int64), np.empty(8))
    for active, worlds, expected in (([True], [0], row), ([False], [0], 0.0 * row), ([True], [], 0.0 * row + 7.0)):
        out = np.full((1, OBSERVATION_SIZE), 7.0, np.float32)
        named = np.array(worlds, np.int64)
        observe(world.ego, world.vehicles, world.pedestrians, np.array(active), named, out)
        assert (out[0] == expected).all()

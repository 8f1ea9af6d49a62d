"""Endings and autoreset: what terminates, what truncates, what follows, and where a source or a budget ends."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from algorithms.scripted_policies import DRIVERS
from envs.driving_env import BudgetExceededError, DrivingVectorEnv
from envs.world import Ending
from tests.envs.roll_outs import FULL_THROTTLE, source
from tests.envs.small_worlds import driving_env

kernels = pytest.mark.kernels


def test_collision_terminates_and_goal_and_time_limit_truncate() -> None:
    env = DrivingVectorEnv("a", 64, source=source("a", 400))
    policies = [DRIVERS[name]() for name in ("full-throttle", "constant-speed", "cruise")]
    observations, _ = env.reset()
    seen = set()
    while env.active.any():
        drive = [policy.act(observations) for policy in policies]
        chosen = np.arange(64) % 3
        observations, _, terminated, truncated, info = env.step(np.choose(chosen[:, None], drive))
        assert not (terminated & truncated).any()
        for record in info.get("finished", ()):
            ending = Ending(record["ending"])
            seen.add(ending)
            assert terminated[record["world"]] == (ending in (Ending.COLLISION, Ending.OFF_ROAD))
            assert truncated[record["world"]] == (ending in (Ending.GOAL, Ending.TIME_OUT))
    assert seen == {Ending.GOAL, Ending.COLLISION, Ending.TIME_OUT}
    records = env.finished_episodes()
    goal = records[records["ending"] == Ending.GOAL]
    assert ((goal["distance"] >= 760.0) & (goal["distance"] < 761.4)).all()
    assert (records["steps"][records["ending"] == Ending.TIME_OUT] == 900).all()
    assert records["steps"].max() == 900


@kernels
def test_leaving_the_road_terminates_without_cost() -> None:
    env = driving_env("a")
    env.reset(seed=0)
    env.world.vehicles["present"] = 0
    env.world.ego["d"] = env.world.ego["reference_d"] = 5.3
    _, _, terminated, truncated, info = env.step(np.zeros((1, 2)))
    assert (terminated[0], truncated[0], info["cost"][0]) == (True, False, 0.0)
    record = info["finished"][0]
    assert (record["ending"], record["fault"], record["steps"]) == (Ending.OFF_ROAD, 0, 1)
    assert info["final_obs"][0] in env.single_observation_space


def test_a_finished_world_starts_its_next_episode_in_the_same_step() -> None:
    n = 4
    env = DrivingVectorEnv("a", n, source=source("a"))
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    env.reset()
    upcoming, checked = n, 0
    while checked < 12:
        before = env.world.copy()
        observations, _, terminated, truncated, info = env.step(np.tile(FULL_THROTTLE, (n, 1)))
        done = terminated | truncated
        assert ("final_obs" in info) == ("_final_obs" in info) == ("finished" in info) == done.any()
        if not done.any():
            continue
        assert info["_final_obs"].tolist() == done.tolist()
        assert info["finished"]["world"].tolist() == np.flatnonzero(done).tolist()
        for i in range(n):
            if not done[i]:
                assert (info["final_obs"][i] == observations[i]).all()
                continue
            # The last observation of the old episode lies beyond the state before the step ...
            assert info["final_obs"][i, 0] * 760.0 >= before.ego["s"][i]
            # ... and the first of the new one is that of the next number of the source.
            assert env.world.episode["episode"][i] == upcoming
            single = DrivingVectorEnv("a", 1, source=source("a", start=upcoming))
            assert (single.reset()[0][0] == observations[i]).all()
            assert (observations[i, 0], env.world.episode["steps"][i]) == (0.0, 0)
            upcoming += 1
            checked += 1


def test_the_final_observation_is_the_state_at_contact() -> None:
    env = DrivingVectorEnv("a", 1, source=source("a", 1))
    env.reset()
    while True:
        observations, _, terminated, _, info = env.step(FULL_THROTTLE[None])
        if terminated[0]:
            break
    # Rear of the leader at contact: centres within 5 m, the same lane; the source has ended, so nothing follows.
    final = info["final_obs"][0]
    assert 0.0 < 200.0 * final[5] <= 5.0
    assert abs(final[6]) < 1e-6
    assert (observations == 0.0).all()
    assert not env.active.any()


def test_without_autoreset_a_finished_world_waits_for_reset() -> None:
    env = DrivingVectorEnv("a", 2, source=source("a", 4), autoreset=False)
    assert env.metadata["autoreset_mode"] is AutoresetMode.DISABLED
    env.reset()
    while env.active.any():
        env.step(np.tile(FULL_THROTTLE, (2, 1)))
    ended = env.world.copy()
    _, reward, terminated, truncated, info = env.step(np.tile(FULL_THROTTLE, (2, 1)))
    assert not (terminated | truncated).any()
    assert (reward == 0.0).all()
    assert (info["cost"] == 0.0).all()
    assert ended.ego.tobytes() == env.world.ego.tobytes()
    env.reset()
    assert env.world.episode["episode"].tolist() == [2, 3]


@kernels
def test_a_reset_mask_starts_new_episodes_in_its_worlds_only() -> None:
    env = driving_env("a", 3, source=source("a", 9), autoreset=False)
    first, _ = env.reset()
    second = env.step(np.ones((3, 2)))[0]
    driven = env.world.copy()
    third, _ = env.reset(options={"reset_mask": np.array([False, True, False])})
    assert env.world.episode["episode"].tolist() == [0, 3, 2]
    assert env.world.episode["steps"].tolist() == [5, 0, 5]
    assert (third[[0, 2]] == second[[0, 2]]).all()
    assert (third[1, 0], second[1, 0] > 0.0) == (0.0, True)
    assert env.world.ego[[0, 2]].tobytes() == driven.ego[[0, 2]].tobytes()
    assert (third[1] != first[1]).any()
    assert env.active.all()


@kernels
@pytest.mark.parametrize(
    ("mask", "error", "message"),
    [
        ([True, False], TypeError, "numpy array of bool"),
        (np.array([1, 0]), TypeError, "numpy array of bool"),
        (np.array([True]), ValueError, r"must have shape \(2,\)"),
        (np.array([False, False]), ValueError, "name at least one world"),
    ],
)
def test_an_unusable_reset_mask_is_refused(mask: object, error: type[Exception], message: str) -> None:
    env = driving_env("a", 2, autoreset=False)
    env.reset(seed=0)
    before = env.world.copy()
    with pytest.raises(error, match=message):
        env.reset(seed=1, options={"reset_mask": mask})
    assert env.world.ego.tobytes() == before.ego.tobytes()


@kernels
def test_a_reset_mask_needs_worlds_that_wait() -> None:
    env = driving_env("a", 2)
    with pytest.raises(ValueError, match=r"reset_mask.*needs autoreset=False"):
        env.reset(seed=0, options={"reset_mask": np.array([True, False])})


def test_an_ended_source_leaves_worlds_idle_and_counts_each_episode_once() -> None:
    env = DrivingVectorEnv("a", 8, source=source("a", 13))
    env.reset()
    while env.active.any():
        env.step(np.tile(FULL_THROTTLE, (8, 1)))
    records = env.finished_episodes()
    assert sorted(records["episode"].tolist()) == list(range(13))
    assert env.episodes_done == 13
    assert (np.diff(records["end_step"]) >= 0).all()
    assert env.recent_episodes(5).tobytes() == records[-5:].tobytes()
    assert env.recent_episodes(99).tobytes() == records.tobytes()


@kernels
def test_more_worlds_than_episodes_leave_some_idle() -> None:
    env = driving_env("a", 3, source=source("a", 2))
    observations, _ = env.reset()
    assert env.active.tolist() == [True, True, False]
    assert (observations[2] == 0.0).all()


@kernels
def test_the_decision_limit_is_kept_to_the_step() -> None:
    env = driving_env("a", 2, decision_limit=3)
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros((2, 2)))
    assert (env.decisions, env.steps_done) == (3, 30)
    with pytest.raises(BudgetExceededError, match="3 decisions per world"):
        env.step(np.zeros((2, 2)))
    assert env.steps_done == 30

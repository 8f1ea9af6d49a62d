"""The gymnasium faces: contracts of others, rewards of decisions, endings, autoreset, determinism, bad input."""

import re
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check_env
from gymnasium.vector import AutoresetMode, VectorEnv
from hypothesis import given, settings
from hypothesis import strategies as st
from stable_baselines3.common.env_checker import check_env as stable_baselines3_check_env

from algorithms.scripted_policies import DRIVERS
from envs.driving_env import (
    ActionMode,
    BudgetExceededError,
    CostSignal,
    DrivingVectorEnv,
    MutatedObservationError,
    action_space,
)
from envs.layout import EpisodeSource, held_out_source
from envs.observation import observation_space
from envs.reward import comfort_reward, speed_reward
from envs.scenario import GYMNASIUM_IDS, get_scenario, scenario_names
from envs.single_env import DrivingEnv
from envs.six_tuple import SixTuple
from envs.world import EPISODE, BoolArray, Ending, FloatArray, World
from tests.envs.small_worlds import driving_env

kernels = pytest.mark.kernels

FULL_THROTTLE = np.array([0.0, 2.0])


def source(name: str, episodes: int | None = None, start: int = 0, seed: int = 11) -> EpisodeSource:
    return EpisodeSource(get_scenario(name), np.random.SeedSequence(seed), start, episodes)


def actions(rng: np.random.Generator, n: int, space: gymnasium.spaces.Box | None = None) -> FloatArray:
    box = space or action_space(ActionMode.ACCELERATION)
    drawn: FloatArray = rng.uniform(box.low, box.high, (n, len(box.low)))
    return drawn


class Recorded:
    """A shield that does what it is told and remembers when it was asked."""

    def __init__(self, acceleration: float | None = None, flag: bool = False, target: float | None = None) -> None:
        self.acceleration, self.flag, self.target = acceleration, flag, target
        self.observed: list[np.ndarray] = []
        self.asked = 0

    def begin(self, seed: np.random.SeedSequence) -> None:
        pass

    def observe(self, observations: np.ndarray) -> None:
        self.observed.append(observations.copy())

    def filter(
        self, world: World, targets: FloatArray, accelerations: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray | None]:
        self.asked += 1
        n = len(world)
        safe = accelerations if self.acceleration is None else np.full(n, self.acceleration)
        where = targets if self.target is None else np.full(n, self.target)
        return where, safe, np.full(n, self.flag), None


# Contracts of others


@pytest.mark.parametrize("gymnasium_id", GYMNASIUM_IDS.values())
def test_every_registered_id_passes_gymnasiums_checker(gymnasium_id: str) -> None:
    env = gymnasium.make(gymnasium_id)
    gymnasium_check_env(env.unwrapped, skip_render_check=True)
    env.close()


@pytest.mark.parametrize("mode", ActionMode)
def test_stable_baselines3s_checker_passes(mode: ActionMode) -> None:
    stable_baselines3_check_env(DrivingEnv("b", action_mode=mode))


@pytest.mark.parametrize(("name", "gymnasium_id"), GYMNASIUM_IDS.items())
def test_gymnasium_makes_the_scenario_of_each_id_in_both_faces(name: str, gymnasium_id: str) -> None:
    env = gymnasium.make(gymnasium_id).unwrapped
    assert isinstance(env, DrivingEnv)
    assert env.vector.scenario is get_scenario(name)
    vector = gymnasium.make_vec(gymnasium_id, num_envs=3)
    assert isinstance(vector.unwrapped, DrivingVectorEnv)
    assert vector.unwrapped.scenario is get_scenario(name)
    assert vector.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    observations, _ = vector.reset(seed=1)
    assert observations in vector.observation_space
    assert observations.shape == (3, 47)
    result = vector.step(vector.action_space.sample())
    assert [part.shape for part in result[:4]] == [(3, 47), (3,), (3,), (3,)]
    assert (result[2].dtype, result[3].dtype) == (np.bool_, np.bool_)


def test_gymnasiums_own_vectorisation_of_the_single_env_works() -> None:
    env = gymnasium.make_vec("bench/MixedTraffic-v1", num_envs=2, vectorization_mode="sync")
    observations, _ = env.reset(seed=3)
    assert observations.shape == (2, 47)
    assert env.step(env.action_space.sample())[0] in env.observation_space


def test_six_tuple_gives_the_cost_as_third_value() -> None:
    env = SixTuple(DrivingEnv("a", source=source("a", 1)))
    env.reset()
    cost, terminated = 0.0, False
    while not terminated:
        observation, reward, cost, terminated, truncated, info = env.step(FULL_THROTTLE)
        assert cost == info["cost"] == float(terminated)
        assert isinstance(reward, float)
        assert observation in env.observation_space
        assert not truncated
    assert cost == 1.0


# Rewards, costs and records


@kernels
@pytest.mark.parametrize("period", ["0.1", "0.5", "1.0"])
def test_the_reward_of_a_decision_is_the_mean_over_its_steps(period: str) -> None:
    # From 10 m/s at 0.5 m/s2, in the middle of a lane, nobody in the way; the first command costs comfort once.
    env = driving_env(f"a:decision_period_s={period}")
    env.reset(seed=0)
    env.world.vehicles["present"] = 0
    env.world.ego["speed"] = 10.0
    _, reward, _, _, info = env.step(np.array([[0.0, 0.5]]))
    steps = round(float(period) / 0.1)
    speeds = [10.0 + 0.05 * (k + 1) for k in range(steps)]
    expected = (sum(map(speed_reward, speeds)) + comfort_reward(0.0, 0.0, 0.5, 0.0)) / steps
    assert reward[0] == pytest.approx(expected)
    assert info["reward_without_risk"][0] == reward[0]


@kernels
def test_without_comfort_the_reward_is_the_driving_agents() -> None:
    env = driving_env("a", comfort=False)
    env.reset(seed=0)
    env.world.vehicles["present"] = 0
    env.world.ego["speed"] = 8.0
    reward = env.step(np.array([[0.0, 0.0]]))[1]
    assert reward[0] == pytest.approx(0.5)
    assert env.step(np.array([[3.5, -2.0]]))[1][0] < 0.5
    assert env.world.episode["return_comfort"][0] < 0.0


@kernels
def test_costs_of_a_decision_are_summed() -> None:
    # 20 m behind a car of the same speed: inside S_safe = 36 m in all five steps.
    env = driving_env("a", cost_signal=CostSignal.PROXIMITY)
    env.reset(seed=0)
    env.world.vehicles["present"][:, 1:] = 0
    for body in (env.world.ego, env.world.vehicles):
        body["speed"] = 10.0
        body["d"] = 0.0
    env.world.ego["reference_d"] = 0.0
    env.world.vehicles["s"] = 25.0
    env.world.vehicles["desired_speed"] = 10.0
    assert env.step(np.array([[0.0, 0.0]]))[4]["cost"][0] == 5.0


@kernels
def test_the_action_is_an_offset_from_the_nearest_lane_clipped_to_the_road() -> None:
    env = driving_env("a")
    env.reset(seed=0)
    cases = [
        (0.3, 1.0, 1.0),
        (-2.0, -1.0, -4.25),
        (3.4, 3.5, 4.25),
        (1.75, 3.5, 3.5),
        (1.76, 3.5, 4.25),
        (9.0, 0.0, 3.5),
    ]
    for d, offset, target in cases:
        env.reset()
        env.world.vehicles["present"] = 0
        env.world.ego["d"] = env.world.ego["reference_d"] = d
        env.step(np.array([[offset, 0.0]]))
        assert env.world.ego["target_d"][0] == pytest.approx(target)


@kernels
def test_the_target_is_held_over_a_decision_though_the_nearest_lane_changes_within_it() -> None:
    env = driving_env("a:decision_period_s=3.0")
    env.reset(seed=0)
    env.world.vehicles["present"] = 0
    env.world.ego["d"] = env.world.ego["reference_d"] = -3.5
    env.step(np.array([[3.5, 0.0]]))
    assert env.world.ego["target_d"][0] == 0.0
    assert env.world.ego["d"][0] == pytest.approx(0.0, abs=0.3)


@kernels
def test_the_driving_agents_action_is_planning_time_offset_and_speed() -> None:
    env = driving_env("a", action_mode=ActionMode.PLANNING)
    box = env.single_action_space
    assert (box.low.tolist(), box.high.tolist()) == ([0.5, -3.5, 0.0], pytest.approx([4.0, 3.5, 13.89]))
    env.reset(seed=0)
    env.world.vehicles["present"] = 0
    env.world.ego["d"] = env.world.ego["reference_d"] = 0.0
    env.world.ego["speed"] = 8.0
    for _ in range(30):
        env.step(np.array([[4.0, 1.0, 11.0]]))
    assert env.world.ego["speed"][0] == pytest.approx(11.0, abs=0.05)
    assert env.world.ego["d"][0] == pytest.approx(1.0, abs=0.05)


@kernels
def test_a_shield_sees_every_step_and_the_observation_once_per_decision() -> None:
    shield = Recorded(acceleration=-1.0, flag=True)
    env = driving_env("a", shield=shield)
    first, _ = env.reset(seed=0)
    speed = env.world.ego["speed"][0]
    _, reward, _, _, info = env.step(FULL_THROTTLE[None])
    assert shield.asked == 5
    assert len(shield.observed) == 1
    assert (shield.observed[0] == first).all()
    assert info["intervened"].tolist() == [5]
    # r_risk = -5 in each step, in the reward but not in the reward without risk.
    assert info["reward_without_risk"][0] - reward[0] == pytest.approx(5.0)
    assert env.world.ego["speed"][0] == pytest.approx(speed - 0.5)
    episode = env.world.episode[0]
    assert (episode["interventions"], episode["altered"], episode["return_risk"]) == (5, 5, -25.0)
    assert episode["altered_acceleration"] == pytest.approx(15.0)


@pytest.mark.parametrize("name", ["a", "b-late", "a-dense-mobil"])
def test_the_returns_of_a_record_are_the_sums_of_its_rewards(name: str) -> None:
    n, rng = 16, np.random.default_rng(2)
    env = DrivingVectorEnv(name, n, shield=Recorded(flag=True), cost_signal=CostSignal.PROXIMITY)
    env.reset(seed=9)
    sums, flagged = np.zeros((3, n)), np.zeros(n, np.int64)
    checked = 0
    while checked < 40:
        _, reward, terminated, truncated, info = env.step(actions(rng, n))
        sums += [reward, info["reward_without_risk"], info["cost"]]
        flagged += info["intervened"]
        for record in info.get("finished", ()):
            i = record["world"]
            base = record["return_driving"] + record["return_comfort"]
            assert 5 * sums[0, i] == pytest.approx(base + record["return_risk"])
            assert 5 * sums[1, i] == pytest.approx(base)
            assert sums[2, i] == record["cost"]
            # Every step of an episode was flagged; the one that ends within a decision leaves the rest out.
            assert flagged[i] == record["interventions"] == record["steps"]
            assert record["return_risk"] == -5.0 * record["steps"]
            checked += 1
        sums[:, terminated | truncated] = 0.0
        flagged[terminated | truncated] = 0


@pytest.mark.parametrize("signal", CostSignal)
def test_an_episode_costs_at_least_1_if_it_collides(signal: CostSignal) -> None:
    env = DrivingVectorEnv("a", 8, cost_signal=signal, source=source("a", 40))
    env.reset()
    while env.active.any():
        env.step(np.tile(FULL_THROTTLE, (8, 1)))
    records = env.finished_episodes()
    collided = records["ending"] == Ending.COLLISION
    assert collided.any()
    assert (records["cost"][collided] >= 1.0).all()
    if signal is CostSignal.COLLISION:
        assert (records["cost"] == collided).all()
        assert ((records["fault"] > 0) == collided).all()


# Endings and autoreset


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


def test_the_single_env_returns_the_last_observation_and_then_asks_for_reset() -> None:
    env = DrivingEnv("a")
    with pytest.raises(RuntimeError, match="call reset"):
        env.step(np.zeros(2))
    env.reset(seed=5)
    terminated = truncated = False
    while not (terminated or truncated):
        observation, reward, terminated, truncated, info = env.step(FULL_THROTTLE)
    assert terminated != truncated
    assert observation.any()
    assert type(reward) is float
    assert {key: type(value) for key, value in info.items()} == {
        "cost": float,
        "reward_without_risk": float,
        "intervened": int,
    }
    with pytest.raises(RuntimeError, match="call reset"):
        env.step(np.zeros(2))


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


# Determinism


def roll_out(env: VectorEnv[Any, Any, Any], steps: int, seed: int = 6) -> list[bytes]:
    rng = np.random.default_rng(seed)
    found = [env.reset(seed=2)[0].tobytes()]
    for _ in range(steps):
        result = env.step(actions(rng, env.num_envs))
        found += [part.tobytes() for part in result[:4]]
    return found


@pytest.mark.parametrize("name", ["b", "a-dense-mobil"])
def test_two_interleaved_environments_give_the_same_bytes(name: str) -> None:
    one, other = (DrivingVectorEnv(name, 5) for _ in range(2))
    rngs = [np.random.default_rng(6) for _ in range(2)]
    assert one.reset(seed=2)[0].tobytes() == other.reset(seed=2)[0].tobytes()
    for _ in range(150):
        mine, theirs = (env.step(actions(rng, 5)) for env, rng in zip((one, other), rngs, strict=True))
        assert [p.tobytes() for p in mine[:4]] == [p.tobytes() for p in theirs[:4]]
    assert one.finished_episodes().tobytes() == other.finished_episodes().tobytes()
    assert one.episodes_done > 0
    assert roll_out(one, 20) == roll_out(other, 20)


def test_another_seed_gives_other_episodes() -> None:
    env = DrivingVectorEnv("a", 2)
    assert env.reset(seed=1)[0].tobytes() != env.reset(seed=2)[0].tobytes()


@pytest.mark.parametrize("name", ["b", "a-dense-mobil"])
def test_two_threads_give_the_same_bytes_as_one(name: str) -> None:
    one, two = (DrivingVectorEnv(name, 17, threads=threads) for threads in (1, 2))
    assert roll_out(one, 120) == roll_out(two, 120)
    assert one.finished_episodes().tobytes() == two.finished_episodes().tobytes()


@pytest.mark.parametrize("name", ["b", "a-dense-mobil"])
def test_a_world_does_not_depend_on_how_many_others_there_are(name: str) -> None:
    rng = np.random.default_rng(8)
    plans = [actions(rng, 180) for _ in range(12)]  # what each episode's driver does, by its number

    def drive(worlds: int) -> dict[int, bytes]:
        env = DrivingVectorEnv(name, worlds, source=source(name, 12))
        observations, _ = env.reset()
        seen: dict[int, list[bytes]] = {k: [] for k in range(12)}
        while env.active.any():
            numbers, steps = env.world.episode["episode"], env.world.episode["steps"] // 5
            for i in np.flatnonzero(env.active):
                seen[int(numbers[i])].append(observations[i].tobytes())
            held = [plans[number][min(step, 179)] for number, step in zip(numbers, steps, strict=True)]
            observations = env.step(np.array(held))[0]
        return {k: b"".join(v) for k, v in seen.items()}

    alone = drive(1)
    assert alone == drive(5) == drive(12)
    assert len(set(alone.values())) == 12


@pytest.mark.parametrize("number", [0, 7, 1023, 1024])
def test_episode_k_of_a_source_replays_identically(number: int) -> None:
    everything = DrivingVectorEnv("b", 1, source=source("b", start=max(0, number - 2)))
    only = DrivingVectorEnv("b", 1, source=source("b", number + 1, start=number))
    only.reset()
    everything.reset()
    while everything.world.episode["episode"][0] != number:
        everything.step(FULL_THROTTLE[None])
    rng = np.random.default_rng(0)
    while only.active.any():
        drawn = actions(rng, 1)
        mine, theirs = only.step(drawn), everything.step(drawn)
        if "final_obs" in mine[4]:
            assert mine[4]["final_obs"].tobytes() == theirs[4]["final_obs"].tobytes()
            names = [name for name in EPISODE.names or () if name != "end_step"]
            assert mine[4]["finished"][names].tolist() == theirs[4]["finished"][names].tolist()
        else:
            assert mine[0].tobytes() == theirs[0].tobytes()
        assert mine[1].tobytes() == theirs[1].tobytes()


@kernels
def test_a_seed_starts_the_source_that_was_given_from_its_beginning_and_replaces_it_by_no_other() -> None:
    env = driving_env("a", 2, source=held_out_source(get_scenario("a"), 4))
    first, _ = env.reset()
    env.reset()
    again, _ = env.reset(seed=123)
    assert (first == again).all()
    assert env.world.episode["episode"].tolist() == [0, 1]


@kernels
def test_without_a_seed_reset_goes_on_in_the_stream() -> None:
    env = driving_env("a", 2)
    env.reset(seed=4)
    env.reset()
    assert env.world.episode["episode"].tolist() == [2, 3]


# Observations


DRIVERS_TO_CHECK = ("random", "full-throttle", "constant-speed")


@pytest.mark.parametrize("name", [*scenario_names()[:8], "a:randomised_traffic=true", "b:decision_period_s=0.1"])
def test_observations_stay_within_their_bounds(name: str) -> None:
    low, high = observation_space().low, observation_space().high
    for driver in DRIVERS_TO_CHECK:
        env = DrivingVectorEnv(name, 32, source=source(name, 64))
        policy = DRIVERS[driver]()
        policy.begin(32, np.random.SeedSequence(1))
        observations, _ = env.reset()
        while env.active.any():
            observations, reward, _, _, info = env.step(policy.act(observations))
            for x in (observations, info.get("final_obs", observations)):
                assert x.dtype == np.float32
                assert (x >= low).all()
                assert (x <= high).all()
            assert np.isfinite(reward).all()


@kernels
@settings(max_examples=20)
@given(st.lists(st.tuples(st.floats(0.5, 4.0), st.floats(-3.5, 3.5), st.floats(0.0, 13.89)), min_size=1, max_size=40))
def test_any_plan_of_the_driving_agent_keeps_to_the_bounds(plan: list[tuple[float, float, float]]) -> None:
    env = driving_env("a-standing", action_mode=ActionMode.PLANNING)
    env.reset(seed=0)
    for action in plan:
        observations, reward, *_ = env.step(np.array([action]))
        assert observations in env.observation_space
        assert np.isfinite(reward).all()


@kernels
def test_returned_arrays_are_not_overwritten_by_later_steps() -> None:
    env = driving_env("a", 2)
    first, _ = env.reset(seed=0)
    kept = first.copy()
    second, reward, _, _, info = env.step(np.ones((2, 2)))
    held = [second.copy(), reward.copy(), info["cost"].copy(), info["intervened"].copy()]
    for _ in range(10):
        env.step(np.ones((2, 2)))
    assert (first == kept).all()
    assert all((a == b).all() for a, b in zip([second, reward, info["cost"], info["intervened"]], held, strict=True))


# Bad input


@kernels
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("world", "entry"), [(0, 0), (0, 1), (2, 1)])
def test_an_action_that_is_not_finite_is_refused_and_changes_nothing(world: int, entry: int, bad: float) -> None:
    env = driving_env("a", 3)
    env.reset(seed=0)
    before = env.world.copy()
    wrong = np.zeros((3, 2))
    wrong[world, entry] = bad
    with pytest.raises(ValueError, match=f"Action entry {entry} of world {world} is {bad}: must be finite"):
        env.step(wrong)
    assert env.world.ego.tobytes() == before.ego.tobytes()
    assert env.decisions == 0


@kernels
@pytest.mark.parametrize("shape", [(2,), (3, 3), (2, 2), (3, 2, 1), (3, 1)])
def test_actions_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    env = driving_env("a", 3)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=re.escape(f"Actions have shape {shape}; expected (3, 2)")):
        env.step(np.zeros(shape))


@kernels
@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("what", ["acceleration", "target"])
def test_a_shields_answer_that_is_not_finite_is_refused(what: str, value: float) -> None:
    env = driving_env("a", 2, shield=Recorded(**{what: value}))
    env.reset(seed=0)
    before = env.world.copy()
    with pytest.raises(ValueError, match=rf"Shield Recorded gave world 0 the {what} {value}: must be finite"):
        env.step(np.zeros((2, 2)))
    assert env.world.ego.tobytes() == before.ego.tobytes()


@kernels
def test_values_beyond_the_action_space_are_clipped_to_it() -> None:
    beyond, at = (driving_env("a") for _ in range(2))
    for env, action in ((beyond, [99.0, -99.0]), (at, [3.5, -2.0])):
        env.reset(seed=0)
        env.step(np.array([action]))
    assert beyond.world.ego.tobytes() == at.world.ego.tobytes()


@pytest.mark.parametrize(("num_envs", "threads"), [(0, 1), (-1, 1), (1, 0)])
def test_worlds_and_threads_are_counted_from_one(num_envs: int, threads: int) -> None:
    with pytest.raises(ValueError, match=f"num_envs = {num_envs}, threads = {threads}: both must be at least 1"):
        DrivingVectorEnv("a", num_envs, threads=threads)


def test_unknown_names_and_values_are_refused_at_construction() -> None:
    with pytest.raises(ValueError, match="Unknown scenario 'c'"):
        DrivingEnv("c")
    with pytest.raises(ValueError, match="vehicles = -4"):
        DrivingEnv("a:vehicles=-4")
    with pytest.raises(ValueError, match="render_mode = 'human'"):
        DrivingEnv("a", render_mode="human")
    with pytest.raises(gymnasium.error.NameNotFound, match="DenseTraffic"):
        gymnasium.make("bench/DenseTrafic-v1")
    with pytest.raises(gymnasium.error.VersionNotFound, match=r"bench/DenseTraffic.*`v1`"):
        gymnasium.make("bench/DenseTraffic-v9")


def test_a_spawn_that_cannot_fit_is_refused_when_episodes_begin() -> None:
    with pytest.raises(ValueError, match="cannot spawn 40 vehicles: at most 27 fit"):
        DrivingEnv("a:vehicles=40").reset(seed=0)


def test_a_watched_environment_refuses_to_go_on_once_its_observations_were_written_into():
    for watched in (True, False):
        env = DrivingVectorEnv("a", 3, watched=watched)
        observations, _ = env.reset(seed=0)
        observations = env.step(np.zeros((3, 2)))[0]
        observations[1, 5] += 0.25
        if watched:
            with pytest.raises(MutatedObservationError, match="copy them first"):
                env.step(np.zeros((3, 2)))
        else:
            env.step(np.zeros((3, 2)))


def test_a_watched_environment_goes_on_from_a_snapshot():
    first, second = (DrivingVectorEnv("a", 3, watched=True) for _ in range(2))
    first.reset(seed=0)
    second.reset(seed=0)
    first.step(np.ones((3, 2)))
    second.restore(first.snapshot())
    assert np.array_equal(second.step(np.ones((3, 2)))[0], first.step(np.ones((3, 2)))[0])

"""Decisions: what an action means, and the rewards, costs and records of the steps that it is held for."""

import numpy as np
import pytest

from envs.driving_env import ActionMode, CostSignal, DrivingVectorEnv
from envs.reward import comfort_reward, speed_reward
from envs.world import Ending
from tests.envs.roll_outs import FULL_THROTTLE, Recorded, actions, source
from tests.envs.small_worlds import driving_env

kernels = pytest.mark.kernels


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

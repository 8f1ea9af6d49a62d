"""The gymnasium faces keep the contracts of others: checkers, registered ids, one world, the six-tuple."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check_env
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.env_checker import check_env as stable_baselines3_check_env

from envs.driving_env import ActionMode, DrivingVectorEnv
from envs.scenario import GYMNASIUM_IDS, get_scenario
from envs.single_env import DrivingEnv
from envs.six_tuple import SixTuple
from tests.envs.roll_outs import FULL_THROTTLE, source


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

"""What stable-baselines3's SAC takes and ours has no update for is refused by name, never ignored."""

import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer

from algorithms.fast_sac import FastSAC
from algorithms.packed_replay import PackedReplayBuffer
from algorithms.sb3_env import StableBaselinesEnv
from envs.driving_env import DrivingVectorEnv


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ent_coef", 0.1),
        ("target_update_interval", 5),
        ("use_sde", True),
        ("n_steps", 3),
        ("replay_buffer_class", ReplayBuffer),
        ("replay_buffer_kwargs", {"handle_timeout_termination": False}),
        ("optimize_memory_usage", True),
        ("policy_kwargs", {"activation_fn": torch.nn.Tanh}),
        ("policy_kwargs", {"n_critics": 1}),
        ("policy_kwargs", {"optimizer_class": torch.optim.SGD}),
    ],
)
def test_an_argument_that_its_update_would_ignore_is_refused_by_name(name, value):
    inner = next(iter(value)) if isinstance(value, dict) else ""
    with pytest.raises(ValueError, match=rf"FastSAC has no {name}.*{inner}.*stable_baselines3\.SAC"):
        FastSAC("MlpPolicy", StableBaselinesEnv(DrivingVectorEnv("a", 1)), device="cpu", **{name: value})


def test_a_normalised_environment_and_observations_that_are_no_vector_are_refused():
    from stable_baselines3.common.envs import SimpleMultiObsEnv
    from stable_baselines3.common.vec_env import VecNormalize

    with pytest.raises(ValueError, match="VecNormalize"):
        FastSAC("MlpPolicy", VecNormalize(StableBaselinesEnv(DrivingVectorEnv("a", 1))), device="cpu")
    with pytest.raises(ValueError, match="observations of Dict"):
        FastSAC("MultiInputPolicy", SimpleMultiObsEnv(discrete_actions=False), device="cpu")


def test_networks_and_spaces_that_its_update_has_no_place_for_are_refused_by_name():
    from stable_baselines3.sac.policies import SACPolicy

    class Smooth(SACPolicy):
        def __init__(self, *args, **kwargs):
            super().__init__(*args, **{**kwargs, "activation_fn": torch.nn.Tanh})

    env = StableBaselinesEnv(DrivingVectorEnv("a", 1))
    with pytest.raises(ValueError, match="FastSAC has no Tanh"):
        FastSAC(Smooth, env, device="cpu")
    with pytest.raises(ValueError, match="FastSAC has no actor without hidden layers"):
        FastSAC("MlpPolicy", env, device="cpu", policy_kwargs={"net_arch": {"pi": [], "qf": [8]}})
    env.action_space = spaces.Box(-1.0, 1.0, (2, 2), np.float32)
    with pytest.raises(ValueError, match="FastSAC has no actions of Box"):
        FastSAC("MlpPolicy", env, device="cpu")
    env.observation_space = spaces.Box(-1.0, 1.0, (3, 2), np.float32)
    with pytest.raises(ValueError, match="FastSAC has no observations of Box"):
        FastSAC("MlpPolicy", env, device="cpu")


def test_a_replay_buffer_of_another_kind_or_width_and_a_later_normalisation_are_refused():
    from stable_baselines3.common.vec_env import VecNormalize

    model = FastSAC("MlpPolicy", StableBaselinesEnv(DrivingVectorEnv("a", 1)), device="cpu", buffer_size=9)
    own, env = model.replay_buffer, model.get_env()
    model.replay_buffer = ReplayBuffer(10, model.observation_space, model.action_space)
    with pytest.raises(ValueError, match="FastSAC has no ReplayBuffer"):
        model.train(1, 64)
    model.replay_buffer = PackedReplayBuffer(10, spaces.Box(-1.0, 1.0, (3,), np.float32), model.action_space)
    with pytest.raises(ValueError, match=r"10 entries, not 2 x 47 \+ 2 \+ 2"):
        model.train(1, 64)
    model.replay_buffer = own
    model.set_env(VecNormalize(env))
    with pytest.raises(ValueError, match="FastSAC has no VecNormalize"):
        model.train(1, 64)

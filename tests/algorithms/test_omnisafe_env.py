"""The CMDP face of a vector environment, and what it leaves behind; needs no OmniSafe but where it says so."""

import os
import random
import sys
import types

import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode

from algorithms import omnisafe_library
from algorithms.method import Budget, Task
from algorithms.omnisafe_env import VectorCMDP, known_to_omnisafe
from algorithms.omnisafe_library import omnisafe_module, process_state_kept
from algorithms.registry import UnavailableMethodError, get_method, list_methods
from envs.scenario import get_scenario
from tests.algorithms.omnisafe_toys import BOUND, HORIZON, Push
from tests.optional import needs_omnisafe

NAMES = ("cpo", "focops", "trpo-lag", "omnisafe")


def cmdp(vector, epochs=None):
    body = {"vector": vector, "epoch_begins": staticmethod(lambda: (epochs if epochs is not None else []).append(1))}
    return type("Bound", (VectorCMDP,), body)("any", num_envs=vector.num_envs)


def push(env, value, worlds):
    return env.step(torch.full((worlds, 1) if worlds > 1 else (1,), value))


def test_a_finished_world_gives_its_last_observation_and_a_mask():
    vector = Push(2)
    env = cmdp(vector)
    env.reset()
    vector.time[1] = HORIZON - 1
    observation, reward, cost, terminated, truncated, info = push(env, 0.5, 2)
    assert truncated.tolist() == [False, True]
    assert terminated.tolist() == [False, False]
    assert info["_final_observation"].tolist() == [False, True]
    np.testing.assert_allclose(info["final_observation"][1], [1.0, 0.05], rtol=1e-6)
    np.testing.assert_allclose(observation, [[0.2, 0.05], [0.0, 0.0]], rtol=1e-6)
    assert cost.tolist() == [0.5, 0.5]
    assert {observation.dtype, reward.dtype, cost.dtype} == {torch.float32}
    assert reward.shape == cost.shape == (2,)


def test_nothing_is_reported_as_final_while_all_worlds_run():
    env = cmdp(Push(2))
    env.reset()
    assert push(env, 0.5, 2)[5] == {}


def test_a_single_world_gives_scalars_for_omnisafe_to_batch():
    env = cmdp(Push(1))
    observation, _ = env.reset()
    assert observation.shape == (2,)
    for _ in range(HORIZON):
        observation, reward, cost, terminated, truncated, info = push(env, 0.5, 1)
    assert reward.shape == cost.shape == terminated.shape == truncated.shape == ()
    assert info["final_observation"].shape == (2,)
    assert bool(truncated)


def test_a_later_epoch_goes_on_with_running_episodes_and_their_cost():
    vector, epochs = Push(2), []
    env = cmdp(vector, epochs)
    env.reset()
    vector.time[1] = HORIZON - 2
    push(env, 0.5, 2)
    push(env, 0.5, 2)  # world 1 ends here, world 0 has two of five decisions behind it
    observation, _ = env.reset()
    np.testing.assert_allclose(observation, [[0.4, 0.1], [0.0, 0.0]], rtol=1e-6)
    cost, info = push(env, 0.25, 2)[2], None
    assert cost.tolist() == [0.25, 0.25]
    env.reset()
    info = push(env, 0.25, 2)[5]
    assert info["original_cost"].tolist() == [1.5, 0.5]
    assert "original_cost" not in push(env, 0.25, 2)[5]
    assert len(epochs) == 3


@needs_omnisafe
def test_network_actions_span_the_physical_box_and_are_clipped_by_the_environment():
    wrapper = omnisafe_module("omnisafe.envs.wrapper")
    vector = Push(3)
    with known_to_omnisafe(vector, lambda: None) as name:
        made = omnisafe_module("omnisafe.envs.core").make(name, num_envs=3)
    env = wrapper.ActionScale(made, device=torch.device("cpu"), low=-1.0, high=1.0)
    env.reset()
    cost = env.step(torch.tensor([[-1.0], [0.25], [7.0]]))[2]
    assert cost.tolist() == [-BOUND, 0.5, BOUND]


@needs_omnisafe
def test_the_environment_is_known_to_omnisafe_only_inside_the_block():
    supported = omnisafe_module("omnisafe.envs.core").support_envs
    with known_to_omnisafe(Push(1), lambda: None) as name:
        assert name in supported()
    assert name not in supported()


def test_another_autoreset_mode_is_refused():
    vector = Push(1)
    vector.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}
    with pytest.raises(ValueError, match="must be SAME_STEP"), known_to_omnisafe(vector, lambda: None):
        pass


def process_state():
    return (
        random.getstate(), np.random.get_state()[1].tobytes(),
        torch.get_rng_state().numpy().tobytes(),
        torch.are_deterministic_algorithms_enabled(), torch.backends.cudnn.enabled, torch.get_num_threads(),
        {key: os.environ.get(key) for key in ("PYTHONHASHSEED", "CUBLAS_WORKSPACE_CONFIG", "OMNISAFE_DEVICE")},
    )  # fmt: skip


@needs_omnisafe
def test_a_training_leaves_the_process_as_it_was(capsys):
    omnisafe_module()
    before, modules = process_state(), set(sys.modules)
    task = Task(get_scenario("a"), 0, Budget(1000))
    get_method("cpo").train(task)
    assert process_state() == before
    assert capsys.readouterr().out == ""
    assert not {"safety_gymnasium", "wandb", "gdown"} & (set(sys.modules) - modules)
    assert torch.distributions.Normal(0.0, 1.0)._validate_args is True
    assert sys.modules["omnisafe.algorithms.on_policy.base.natural_pg"].DataLoader is torch.utils.data.DataLoader


def test_process_state_comes_back_after_an_error():
    before = process_state()

    def disturb():
        random.seed(1)
        np.random.seed(1)
        torch.manual_seed(1)
        torch.use_deterministic_algorithms(True)
        os.environ["OMNISAFE_DEVICE"] = "cpu"
        raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"), process_state_kept():
        disturb()
    assert process_state() == before


@pytest.mark.parametrize("missing", ["omnisafe", "yaml"])
def test_without_it_the_methods_are_unavailable_and_say_what_helps(monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    for name in NAMES:
        with pytest.raises(UnavailableMethodError, match=f"'{missing}'.*pip install --no-deps omnisafe==0.5.0"):
            get_method(name)
    listed = {listing.name: listing for listing in list_methods()}
    assert not any(listed[name].available for name in NAMES)
    assert listed["sac"].available


def test_a_release_that_fails_to_import_is_named_with_its_reason(monkeypatch):
    def fail(name):
        raise AttributeError("module 'numpy' has no attribute 'float_'")

    monkeypatch.delitem(sys.modules, "omnisafe", raising=False)
    monkeypatch.setattr(omnisafe_library.importlib, "import_module", fail)
    with pytest.raises(UnavailableMethodError, match=r"AttributeError: module 'numpy'.*pip install"):
        omnisafe_module()


def test_a_stand_in_imports_but_does_not_work():
    stand_in = omnisafe_library.stand_in("safety_gymnasium")
    assert isinstance(stand_in, types.ModuleType)
    with pytest.raises(UnavailableMethodError, match=r"safety_gymnasium\.make is a stand-in"):
        stand_in.make("SafetyPointGoal1-v0")
    with pytest.raises(AttributeError):
        _ = stand_in.__path__

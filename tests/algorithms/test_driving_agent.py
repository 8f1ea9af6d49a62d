"""The driving agent: what it is trained for, and that its version reaches every key and version that rests on it."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from algorithms import driving_agent, risk_training, sac, safety_guard
from algorithms.driving_agent import DrivingAgentSpec
from algorithms.method import Budget, Task
from algorithms.registry import get_method
from envs.driving_env import ActionMode, DrivingVectorEnv

ALGORITHMS = Path(sac.__file__).parent


@pytest.fixture
def fresh(monkeypatch):
    """A module of `algorithms`, executed once more with what is patched by now, in place of the first for the test."""

    def load(name):
        spec = importlib.util.spec_from_file_location(f"algorithms.{name}", ALGORITHMS / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, f"algorithms.{name}", module)
        spec.loader.exec_module(module)
        return module

    return load


def test_a_raised_learner_names_another_agent_and_a_raised_agent_another_one(monkeypatch, fresh):
    kept = DrivingAgentSpec("a", 4_000).key
    assert fresh("driving_agent").DrivingAgentSpec("a", 4_000).key == kept
    monkeypatch.setattr(sac, "LEARNER_VERSION", sac.LEARNER_VERSION + 1)
    assert fresh("driving_agent").DrivingAgentSpec("a", 4_000).key != kept
    monkeypatch.undo()
    monkeypatch.setattr(driving_agent, "VERSION", driving_agent.VERSION + 1)
    assert DrivingAgentSpec("a", 4_000).key != kept


@pytest.mark.parametrize(
    ("module", "constant"),
    [
        (safety_guard, "GUARD_VERSION"),
        (sac, "LEARNER_VERSION"),
        (driving_agent, "VERSION"),
        (risk_training, "VERSION"),
    ],
)
def test_what_raises_guard_learner_agent_or_model_raises_the_methods_behind_a_risk_model(
    monkeypatch, fresh, module, constant
):
    before = get_method("dd-rq").version, get_method("dd-rq-plus").version
    monkeypatch.setattr(module, constant, getattr(module, constant) + 1)
    if module is sac:
        fresh("driving_agent")
    after = fresh("dd_rq").DDRQ.version, fresh("dd_rq_plus").DDRQPlus.version
    assert after == (before[0] + 1, before[1] + 1)


def test_versions_and_the_constants_that_they_stand_for_go_together():
    versions = {name: get_method(name).version for name in ("sac", "safety-guard", "dd-rq", "dd-rq-plus")}
    found = {
        "learner": (sac.LEARNER_VERSION, sac.GAMMA_PER_STEP, sac.ACTOR_LAYERS, sac.CRITIC_LAYERS, sac.SACSettings()),
        "agent": driving_agent.VERSION,
        "model": risk_training.VERSION,
        "methods": versions,
    }
    settings = sac.SACSettings(16, 4, 64, 1600, 3e-4, 5e-3, "fast")
    assert found == {
        "learner": (2, 0.99, (256, 256, 256, 256), (256, 256, 256), settings),
        "agent": 1,
        "model": 1,
        "methods": {"sac": 2, "safety-guard": 6, "dd-rq": 6, "dd-rq-plus": 7},
    }, "A change that alters results raises the version that it belongs to; only with it is this list written anew."


def test_the_agents_of_the_committed_records_keep_their_names():
    # policy/risk.json of every DD-RQ record holds the name, and its digest is part of the record's seal.
    assert DrivingAgentSpec("a", 500_000).key == "driving-agent-38d4df8e315b"
    assert DrivingAgentSpec("b", 500_000).key == "driving-agent-4aa87703e9be"


class Stopped(Exception):
    """Ends a training before it has begun."""


def test_it_plans_and_is_paid_for_driving_without_comfort(tmp_path, monkeypatch):
    seen = []

    def learner(_policy, env, **_arguments):
        seen.append(env.env)
        raise Stopped

    monkeypatch.setitem(sac.LEARNERS, "fast", learner)
    with pytest.raises(Stopped):
        driving_agent.driving_agent(DrivingAgentSpec("a", 4_000), tmp_path)
    (env,) = seen
    assert env.action_mode is ActionMode.PLANNING
    source = Task(env.scenario, 0, Budget(4_000)).episodes()
    plain, comfortable = (
        DrivingVectorEnv("a", env.num_envs, source=source, action_mode=ActionMode.PLANNING, comfort=comfort)
        for comfort in (False, True)
    )
    plans = [np.tile([0.5, 3.5, speed], (env.num_envs, 1)) for speed in (13.89, 0.0, 13.89, 0.0)]
    rewards = []
    for each in (env, plain, comfortable):
        each.reset()
        rewards.append(np.array([each.step(plan)[1] for plan in plans]))
    assert np.array_equal(rewards[0], rewards[1])
    assert not np.array_equal(rewards[0], rewards[2])

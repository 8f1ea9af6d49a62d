"""The driving agent: what it is trained for, and that its version reaches every key and version that rests on it."""

import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from algorithms import driving_agent, sac, sac_training, versions
from algorithms.driving_agent import DrivingAgentSpec
from algorithms.method import Budget, Task
from algorithms.registry import get_method
from envs.driving_env import ActionMode, DrivingVectorEnv

ALGORITHMS = Path(sac.__file__).parent


@pytest.fixture
def raised(monkeypatch):
    """Modules of `algorithms`, executed once more for the test with one version raised."""

    def load(constant, *names):
        for name in ("versions", *names):
            spec = importlib.util.spec_from_file_location(f"algorithms.{name}", ALGORITHMS / f"{name}.py")
            module = importlib.util.module_from_spec(spec)
            monkeypatch.setitem(sys.modules, f"algorithms.{name}", module)
            source = Path(spec.origin).read_text("utf-8")
            if name == "versions" and constant is not None:
                source, found = re.subn(rf"^({constant}: Final = .+)$", r"\1 + 1", source, flags=re.MULTILINE)
                assert found == 1
            exec(compile(source, spec.origin, "exec"), module.__dict__)
            yield module

    return load


def test_a_raised_learner_names_another_agent_and_a_raised_agent_another_one(raised):
    kept = DrivingAgentSpec("a", 4_000).key
    for constant in (None, "LEARNER_VERSION", "AGENT_VERSION"):
        _, again = raised(constant, "driving_agent")
        assert (again.DrivingAgentSpec("a", 4_000).key == kept) is (constant is None)


@pytest.mark.parametrize("constant", ["GUARD_VERSION", "LEARNER_VERSION", "AGENT_VERSION", "MODEL_VERSION"])
def test_what_raises_guard_learner_agent_or_model_raises_the_methods_behind_a_risk_model(raised, constant):
    before = get_method("dd-rq").version, get_method("dd-rq-plus").version
    _, paper, plus = raised(constant, "dd_rq", "dd_rq_plus")
    assert (paper.DDRQ.version, plus.DDRQPlus.version) == (before[0] + 1, before[1] + 1)


def test_versions_and_the_constants_that_they_stand_for_go_together():
    found = {
        "constants": (sac.GAMMA_PER_STEP, sac.ACTOR_LAYERS, sac.CRITIC_LAYERS, sac.SACSettings()),
        "learner": versions.LEARNER_VERSION,
        "agent": versions.AGENT_VERSION,
        "model": versions.MODEL_VERSION,
        "methods": {name: get_method(name).version for name in ("sac", "safety-guard", "dd-rq", "dd-rq-plus")},
    }
    settings = sac.SACSettings(16, 4, 64, 1600, 3e-4, 5e-3, "fast")
    assert found == {
        "constants": (0.99, (256, 256, 256, 256), (256, 256, 256), settings),
        "learner": 2,
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

    monkeypatch.setitem(sac_training.LEARNER_CLASSES, "fast", learner)
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

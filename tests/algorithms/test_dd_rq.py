"""DD-RQ, the fixed guard and the controls as methods."""

import json
import math

import numpy as np
import pytest
import torch

from algorithms.artefacts import cached
from algorithms.method import Budget, Task
from algorithms.registry import get_method
from algorithms.risk_guard import RiskGuard
from algorithms.risk_model import RiskArchitecture, RiskModel, RiskModelFileError, RiskNetwork, RiskOutput
from envs.driving_env import DrivingVectorEnv
from envs.observation import decode
from envs.scenario import get_scenario
from envs.world import empty_world


class Model:
    """A risk model that says what it is told."""

    def __init__(self, value):
        self.value = value
        self.description = {"value_mean": 1.7, "value_quantiles": [0.5, 4.0]}

    def __call__(self, observations):
        n = len(observations)
        importance = np.zeros((n, 8))
        importance[:, 0] = 1.0
        return RiskOutput(np.full(n, self.value), importance)


def observed(guard, scenario="b", worlds=4):
    env = DrivingVectorEnv(scenario, worlds, shield=guard)
    observations, _ = env.reset(seed=2)
    guard.observe(observations)
    return env, observations


def test_the_models_planning_time_becomes_the_adjustment_time():
    guard = RiskGuard(Model(2.2))
    env, _ = observed(guard)
    assert guard.horizons(env.world) == pytest.approx([2.2] * 4)
    assert guard.risk == pytest.approx([100.0 * 1.8 / 3.5] * 4)


@pytest.mark.parametrize(("tc", "rq", "expected"), [("mean", "model", 1.7), ("model", "printed", 4.5 - 2.2)])
def test_controls_replace_the_models_value(tc, rq, expected):
    guard = RiskGuard(Model(2.2), tc, rq)
    env, _ = observed(guard)
    assert guard.horizons(env.world) == pytest.approx([expected] * 4)


def test_the_shuffled_control_draws_from_the_distribution_and_repeats_with_its_seed():
    guard = RiskGuard(Model(2.2), rq="shuffled")
    drawn = []
    for _ in range(2):
        guard.begin(np.random.SeedSequence(7))
        env, _ = observed(guard)
        drawn.append(guard.horizons(env.world).copy())
    assert np.array_equal(drawn[0], drawn[1])
    assert len(set(drawn[0])) == 4


def test_importance_reaches_the_object_that_its_slot_shows():
    guard = RiskGuard(Model(2.2))
    env, observations = observed(guard, "a-dense", 16)
    importance = guard.importance(env.world)
    nearest = np.abs(env.world.vehicles["s"] - env.world.ego["s"][:, None]).argmin(1)
    assert np.array_equal(importance.argmax(1), nearest)
    assert importance.sum(1) == pytest.approx(np.ones(16))
    shown = decode(observations).vehicle_ds[:, 0]
    expected = np.take_along_axis(env.world.vehicles["s"], nearest[:, None], 1)[:, 0] - env.world.ego["s"]
    assert shown == pytest.approx(expected, abs=1e-4)


def test_an_empty_world_passes_the_action_through_a_guard_with_a_risk_model():
    torch.manual_seed(0)
    size = RiskArchitecture()
    guard = RiskGuard(RiskModel(RiskNetwork(size), size, {}))
    world, observations = empty_world(2, 5, 3), np.zeros((2, 47), np.float32)
    guard.observe(observations)
    targets, accelerations = np.array([3.5, -1.0]), np.array([1.7, -2.0])
    executed = guard.filter(world, targets, accelerations)
    assert np.array_equal(executed[0], targets)
    assert np.array_equal(executed[1], accelerations)
    assert not executed[2].any()


def test_a_risk_model_that_gives_no_number_is_named_with_the_world():
    guard = RiskGuard(Model(math.nan))
    env, _ = observed(guard)
    with pytest.raises(ValueError, match=r"T_c = nan s in world 0"):
        guard.filter(env.world, np.zeros(4), np.zeros(4))


def test_a_policy_of_another_scenario_version_or_layout_is_refused_by_name(tmp_path):
    size = RiskArchitecture()
    RiskModel(RiskNetwork(size), size, {"scenario": "a-v0"}).save(tmp_path)
    task = Task(get_scenario("a"), 0, Budget(1600))
    for spec in ("dd-rq", "dd-rq-plus"):
        with pytest.raises(RiskModelFileError, match=r"'a-v0'.*'a-v1'"):
            get_method(spec).load_policy(tmp_path, task)
    text = json.loads((tmp_path / "risk.json").read_text())
    (tmp_path / "risk.json").write_text(json.dumps(text | {"layout_version": 0}))
    with pytest.raises(RiskModelFileError, match="state layout 0"):
        get_method("dd-rq").load_policy(tmp_path, task)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("safety-guard:tc=0", "T_c = 0.0"),
        ("safety-guard:tc=nan", "T_c = nan"),
        ("safety-guard:tc=three", "expected float"),
        ("dd-rq:rq=shuffeld", "shuffled"),
        ("dd-rq:tk=1", "tc"),
    ],
)
def test_bad_parameters_are_named(spec, message):
    with pytest.raises(ValueError, match=message):
        get_method(spec)


def test_dd_rq_trains_saves_and_loads_at_a_token_budget(tmp_path):
    method = get_method("dd-rq")
    task = Task(get_scenario("a"), 0, Budget(1600), cache=tmp_path / "cache")
    policy = method.train(task)
    folder = tmp_path / "policy"
    folder.mkdir()
    policy.save(folder)
    loaded = method.load_policy(folder, task)
    env = DrivingVectorEnv("a", 8, shield=policy.shield)
    observations, _ = env.reset(seed=0)
    assert np.array_equal(policy.act(observations), loaded.act(observations))
    policy.shield.observe(observations)
    loaded.shield.observe(observations)
    assert np.array_equal(policy.shield.horizons(env.world), loaded.shield.horizons(env.world))
    assert task.steps_done() == 1600
    agents = list((tmp_path / "cache").glob("driving-agent-*/agent.json"))
    assert len(agents) == 1
    assert json.loads(agents[0].read_text())["curve"]
    # A second seed finds the shared artefacts and trains neither again.
    stamp = agents[0].stat().st_mtime_ns
    method.train(Task(get_scenario("a"), 1, Budget(1600), cache=tmp_path / "cache"))
    assert agents[0].stat().st_mtime_ns == stamp


def test_an_artefact_that_fails_to_build_leaves_nothing(tmp_path):
    def fail(folder):
        (folder / "half").write_text("x")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        cached(tmp_path / "thing", fail)
    assert [path.name for path in tmp_path.iterdir()] == ["thing.lock"]
    assert cached(tmp_path / "thing", lambda folder: (folder / "whole").touch()).joinpath("whole").exists()

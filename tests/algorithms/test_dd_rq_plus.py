"""DD-RQ-plus: labels from outcomes, the demanded share of S_safe, and safety at any share."""

import json

import numpy as np
import pytest
from scipy.special import logit

from algorithms.method import Budget, Task
from algorithms.registry import get_method
from algorithms.risk_guard import ShareGuard
from algorithms.risk_model import RiskOutput
from algorithms.risk_training import CONTACT, PLANNING_TIME, RiskSettings, collect
from algorithms.safety_guard import SafetyGuard
from algorithms.scripted_policies import FullThrottlePolicy, RandomPolicy
from envs.driving_env import ActionMode, DrivingVectorEnv
from envs.scenario import get_scenario
from envs.world import empty_world


class Model:
    """A model of contact that says what it is told."""

    def __init__(self, probability):
        self.logit = logit(probability)
        self.description = {"value_mean": 0.3, "value_quantiles": [0.1, 0.9]}

    def __call__(self, observations):
        return RiskOutput(np.full(len(observations), self.logit), np.zeros((len(observations), 8)))


def follower(gap, speed=10.0):
    """An ego behind a car of equal speed, bumper to bumper `gap` [m]."""
    world = empty_world(1, 1, 0)
    world.ego["speed"] = world.vehicles["speed"] = speed
    world.vehicles["present"], world.vehicles["s"] = 1, gap + 5.0
    return world


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 1.0])
def test_a_share_of_the_safe_gap_is_demanded(share):
    # v = 10 m/s: S_safe = 36 m, T_c = 3 s, equal speeds: a = 2 (30 - share 36) / 9; the stopping bound lies above.
    guard = SafetyGuard(3.0, share=share)
    guard.filter(follower(30.0), np.zeros(1), np.zeros(1))
    assert guard.limits[0, 0] == pytest.approx(min(2.0 * (30.0 - 36.0 * share) / 9.0, guard_bound(30.0)))


def guard_bound(gap):
    guard = SafetyGuard(0.5, share=0.0)
    guard.filter(follower(gap), np.zeros(1), np.zeros(1))
    return guard.limits[0, 0]


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan")])
def test_a_share_outside_zero_and_one_is_named(share):
    with pytest.raises(ValueError, match="share = "):
        SafetyGuard(3.0, share=share)
    with pytest.raises(ValueError, match="share = "):
        get_method(f"safety-guard:share={share}")


@pytest.mark.parametrize(("source", "expected"), [("risk", 0.8), ("mean", 0.3)])
def test_the_probability_of_contact_is_the_share(source, expected):
    guard = ShareGuard(Model(0.8), share=source)
    env = DrivingVectorEnv("b", 4, shield=guard)
    guard.observe(env.reset(seed=2)[0])
    assert guard.shares(env.world) == pytest.approx([expected] * 4)
    assert guard.horizons(env.world) == pytest.approx([3.0] * 4)
    assert guard.risk == pytest.approx([100.0 * expected] * 4)


def test_the_shuffled_control_draws_from_the_distribution_and_repeats_with_its_seed():
    guard = ShareGuard(Model(0.8), share="shuffled")
    env = DrivingVectorEnv("b", 4, shield=guard)
    observations, _ = env.reset(seed=2)
    drawn = []
    for _ in range(2):
        guard.begin(np.random.SeedSequence(7))
        guard.observe(observations)
        drawn.append(guard.shares(env.world).copy())
    assert np.array_equal(drawn[0], drawn[1])
    assert len(set(drawn[0])) == 4
    assert (np.abs(drawn[0] - 0.5) <= 0.4).all()


def test_an_unknown_source_is_named():
    with pytest.raises(ValueError, match="shuffeld"):
        get_method("dd-rq-plus:share=shuffeld")


@pytest.mark.parametrize("scenario", ["a", "b"])
@pytest.mark.parametrize("driver", [RandomPolicy, FullThrottlePolicy])
def test_even_without_any_demand_nobody_is_hit(scenario, driver):
    env = DrivingVectorEnv(scenario, 64, shield=SafetyGuard(3.0, share=0.0))
    policy = driver()
    observations, _ = env.reset(seed=3)
    while env.episodes_done < 128:
        observations, *_ = env.step(policy.act(observations))
    assert not env.finished_episodes()["ego_at_fault"].any()


class Rammer(RandomPolicy):
    """Keeps its lane at full throttle, in the driving agent's action: surely hits what is ahead."""

    action_mode = ActionMode.PLANNING

    def act(self, observations):
        return np.tile([2.0, 0.0, 13.89], (len(observations), 1))


def test_labels_precede_contacts_by_three_seconds_and_planning_times_are_the_agents():
    scenario = get_scenario("a")
    risky = collect(Rammer(), scenario, RiskSettings(samples=25_600, label=CONTACT))
    assert risky.observations.shape == (25_600, 47)
    assert set(np.unique(risky.labels)) == {0.0, 1.0}
    # A contact ends a run of six decisions, in every world in which such a run has ended.
    by_world = risky.labels.reshape(-1, 256)
    ended = [np.flatnonzero(np.diff(column) < 0) for column in by_world.T]
    runs = [column[k - 5 : k + 1].sum() for column, last in zip(by_world.T, ended, strict=True) for k in last if k > 5]
    longer = [column[k - 6] for column, last in zip(by_world.T, ended, strict=True) for k in last if k > 5]
    assert len(runs) > 50
    assert np.mean(runs) == pytest.approx(6.0, abs=0.05)
    assert np.mean(longer) < 0.05
    times = collect(Rammer(), scenario, RiskSettings(samples=2_560, label=PLANNING_TIME))
    assert (times.labels == 2.0).all()


@pytest.mark.slow
def test_a_smoke_run_trains_saves_and_loads(tmp_path):
    method = get_method("dd-rq-plus")
    task = Task(get_scenario("a"), 0, Budget(4_000), cache=tmp_path / "cache")
    policy = method.train(task)
    (tmp_path / "policy").mkdir()
    policy.save(tmp_path / "policy")
    loaded = method.load_policy(tmp_path / "policy", task)
    observations = np.random.default_rng(0).uniform(0, 1, (8, 47)).astype(np.float32)
    assert np.array_equal(policy.act(observations), loaded.act(observations))
    description = json.loads((tmp_path / "policy" / "risk.json").read_text())["description"]
    assert description["settings"]["label"] == CONTACT

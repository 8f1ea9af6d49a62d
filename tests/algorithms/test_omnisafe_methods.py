"""The methods on our scenarios: budget, settings, policies; every algorithm at smoke budget."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from algorithms.method import Budget, Task, seed_sequence
from algorithms.omnisafe_library import algorithm_defaults
from algorithms.omnisafe_methods import ALGORITHMS
from algorithms.omnisafe_settings import OmniSafeSettings, Schedule, configuration, plan, settings_of
from algorithms.omnisafe_training import longest_episode
from algorithms.registry import get_method
from bench import runner
from bench.protocols import PROTOCOLS, Request, expand
from envs.observation import OBSERVATION_SIZE
from envs.scenario import UnknownNameError, get_scenario
from envs.world import Ending
from tests.optional import needs_omnisafe

LAGRANGIAN = {"CPPOPID", "CUP", "FOCOPS", "IPO", "PDO", "PPOLag", "RCPO", "TRPOLag", "TRPOPID"}
SECOND_ORDER_OR_PENALTY = {"CPO", "IPO", "OnCRPO", "P3O", "PCPO"}
UNCONSTRAINED = {"NaturalPG", "PPO", "PolicyGradient", "TRPO"}


@given(st.integers(1, 300_000), st.integers(1, 900), st.integers(1, 40), st.integers(1, 10_000), st.integers(1, 30))
def test_a_plan_spends_the_budget_to_the_decision(decisions, longest, worlds, epoch_decisions, least_epochs):
    settings = OmniSafeSettings(worlds=worlds, epoch_decisions=epoch_decisions, least_epochs=least_epochs)
    if decisions < longest:
        with pytest.raises(ValueError, match=f"at least the longest episode, {longest} decisions"):
            plan(decisions, longest, settings)
        return
    found = plan(decisions, longest, settings)
    assert found.worlds * (found.epochs * found.steps + found.rest) == decisions
    assert found.worlds <= worlds
    assert found.steps >= longest
    assert found.rest < found.epochs


@pytest.mark.parametrize(
    ("decisions", "expected"),
    [
        (20_000, (10, 10, 200, 0)),
        (100_000, (20, 25, 200, 0)),
        (200_000, (20, 50, 200, 0)),
        (1_000, (1, 5, 200, 0)),
        (100_003, (1, 21, 4762, 1)),  # a prime: one world, and the updates miss one decision
    ],
)
def test_plans_of_common_budgets(decisions, expected):
    found = plan(decisions, 180, OmniSafeSettings())
    assert (found.worlds, found.epochs, found.steps, found.rest) == expected


@pytest.mark.parametrize(
    ("name", "decisions"), [("a", 180), ("a:decision_period_s=0.1", 900), ("b:decision_period_s=0.4", 225)]
)
def test_the_longest_episode_is_ninety_seconds(name, decisions):
    assert longest_episode(get_scenario(name)) == decisions


@needs_omnisafe
@pytest.mark.parametrize("steps", [900, 1005, 4010])
def test_a_training_uses_its_budget_exactly(steps):
    task = Task(get_scenario("a"), 0, Budget(steps))
    get_method("cpo").train(task)
    assert task.steps_done() == steps


@needs_omnisafe
def test_a_budget_below_one_episode_is_refused():
    with pytest.raises(ValueError, match="A budget of 179 decisions is too small"):
        get_method("cpo").train(Task(get_scenario("a"), 0, Budget(895)))


@needs_omnisafe
def test_progress_tells_of_every_epoch_and_no_mean_cost_is_nan():
    told = []
    settings = {"epoch_decisions": "400", "least_epochs": "3"}
    task = Task(get_scenario("a"), 0, Budget(6000), settings=settings, progress=lambda n, s: told.append((n, s)))
    get_method("trpo-lag").train(task)
    assert [steps for steps, _ in told] == [0, 2000, 4000, 6000]
    assert all(math.isfinite(scalars["episode_cost"]) for _, scalars in told[1:])
    assert all(math.isfinite(scalars["multiplier"]) for _, scalars in told)
    assert {"return", "collision_rate", "speed_mps"} <= set(told[-1][1])


@needs_omnisafe
def test_the_same_seed_gives_the_same_policy_another_seed_another_one():
    def weights(seed):
        policy = get_method("focops").train(Task(get_scenario("a"), seed, Budget(1000)))
        return torch.cat([parameter.flatten() for parameter in policy.network.parameters()])

    first, other, again = weights(0), weights(1), weights(0)
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


@needs_omnisafe
@pytest.mark.parametrize("spec", ["cpo", "omnisafe:algo=PPOLag"])
def test_a_saved_policy_acts_as_before(spec, tmp_path):
    method, task = get_method(spec), Task(get_scenario("b"), 0, Budget(1000))
    policy = method.train(task)
    policy.save(tmp_path)
    observations = np.random.default_rng(0).normal(size=(20, OBSERVATION_SIZE)).astype(np.float32)
    loaded = method.load_policy(tmp_path, task)
    policy.begin(20, seed_sequence("test"))
    np.testing.assert_array_equal(loaded.act(observations), policy.act(observations))
    assert np.abs(policy.act(1e4 * observations)).max(axis=0) == pytest.approx([3.5, 2.0])
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".json", ".safetensors"]


@needs_omnisafe
@pytest.mark.slow
@pytest.mark.parametrize("algorithm", sorted(set(ALGORITHMS) - {"CPO", "FOCOPS", "TRPOLag"}))
def test_every_other_on_policy_algorithm_runs(algorithm):
    task = Task(get_scenario("b"), 0, Budget(PROTOCOLS["smoke"].steps))
    policy = get_method(f"omnisafe:algo={algorithm}").train(task)
    assert task.steps_done() == PROTOCOLS["smoke"].steps
    assert np.isfinite(policy.act(np.zeros((3, OBSERVATION_SIZE), np.float32))).all()


def test_an_unknown_algorithm_is_refused_with_the_nearest_name():
    with pytest.raises(UnknownNameError, match="Did you mean PCPO"):
        get_method("omnisafe:algo=PCPOO")


@pytest.mark.parametrize("algorithm", ["PPOSaute", "TRPOSimmerPID", "PPOEarlyTerminated"])
def test_algorithms_that_change_the_observation_are_refused(algorithm):
    with pytest.raises(UnknownNameError):
        get_method(f"omnisafe:algo={algorithm}")


def chosen_for(algorithm, cost_limit):
    schedule = Schedule(20, 25, 200, 0)
    return configuration(
        algorithm_defaults(algorithm), settings_of(algorithm), schedule, cost_limit=cost_limit, gamma=0.9, seed=0
    )


@needs_omnisafe
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_cost_limit_lands_where_the_algorithm_reads_it(algorithm):
    chosen = chosen_for(algorithm, cost_limit=0.0123)
    holders = {name for name, section in chosen.items() if isinstance(section, dict) and "cost_limit" in section}
    assert {chosen[name]["cost_limit"] for name in holders} <= {0.0123}
    wanted = {"lagrange_cfgs"} if algorithm in LAGRANGIAN else set()
    wanted |= {"algo_cfgs"} if algorithm in SECOND_ORDER_OR_PENALTY else set()
    assert holders == wanted
    assert (algorithm in UNCONSTRAINED) == (holders == set())


@needs_omnisafe
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_what_users_trip_over_is_set(algorithm):
    chosen = chosen_for(algorithm, cost_limit=0.05)
    section = chosen["algo_cfgs"]
    assert not section["obs_normalize"]
    assert not section["reward_normalize"]
    assert not section["cost_normalize"]
    assert section["gamma"] == section["cost_gamma"] == 0.9
    assert chosen["train_cfgs"]["torch_threads"] == 1
    assert chosen["model_cfgs"]["actor"]["hidden_sizes"] == [256] * 4
    assert chosen["model_cfgs"]["critic"]["hidden_sizes"] == [256] * 3
    sections = [section for section in chosen.values() if isinstance(section, dict)]
    assert None not in [value for section in sections for value in section.values()]


@needs_omnisafe
@pytest.mark.parametrize(("method", "section"), [("cpo", "algo_cfgs"), ("focops", "lagrange_cfgs")])
@pytest.mark.parametrize(("signal", "most"), [("collision", 1.0), ("proximity", math.inf), ("ttc", math.inf)])
def test_a_run_trains_and_is_judged_under_the_cost_contract_it_was_given(
    monkeypatch, tmp_path, method, section, signal, most
):
    """From ``bench run --set cost.limit=0.01 --set cost.signal=...`` to what OmniSafe gets."""
    given = {}

    def full_throttle(algorithm, vector, chosen, *_):
        vector.reset()
        throttle = np.tile([0.0, 2.0], (vector.num_envs, 1))
        costs = [vector.step(throttle)[4]["cost"] for _ in range(vector.decision_limit)]
        given.update(limit=chosen[section]["cost_limit"], cost=np.sum(costs), largest=np.max(costs))
        return torch.nn.Sequential(torch.nn.Linear(OBSERVATION_SIZE, 2))

    monkeypatch.setattr("algorithms.omnisafe_training.train_actor", full_throttle)
    monkeypatch.setattr("algorithms.omnisafe_training.ACTOR_LAYERS", ())
    settings = ["cost.limit=0.01", f"cost.signal={signal}"]
    [spec] = expand(Request(method, "a", "smoke", settings=settings, eval_episodes=20)).specs
    record = runner.run(spec, tmp_path)
    trained = record.train_episodes().to_pandas()
    assert given["limit"] == 0.01
    assert 1.0 <= given["largest"] <= most
    assert trained["cost"].sum() <= given["cost"]
    crashes = int((trained["ending"] == Ending.COLLISION).sum())
    assert crashes > 0
    assert (given["cost"] == crashes) == (signal == "collision")
    assert {"cost_limit": 0.01, "cost_signal": signal}.items() <= record.spec.model_dump().items()


def test_settings_are_parsed_by_type_and_checked():
    changed = OmniSafeSettings().with_changes({"worlds": "4", "kl_limit": "0.5", "unrelated": "x"})
    assert (changed.worlds, changed.kl_limit) == (4, 0.5)
    with pytest.raises(ValueError, match="worlds = 'many': expected int"):
        OmniSafeSettings().with_changes({"worlds": "many"})
    with pytest.raises(ValueError, match="batch = 0: must be at least 1"):
        OmniSafeSettings(batch=0)
    with pytest.raises(ValueError, match="kl_limit = nan: must be at least 0"):
        OmniSafeSettings(kl_limit=math.nan)

"""Records of policies that are really driven, for replays and reports."""

from pathlib import Path

import torch

from algorithms.method import Budget, Policy, Task
from algorithms.networks import Architecture, NetworkPolicy
from algorithms.registry import get_method
from algorithms.risk_guard import RiskGuard, RiskGuardedPolicy
from algorithms.risk_model import RiskArchitecture, RiskModel, RiskNetwork
from algorithms.safety_guard import SafetyGuard
from bench import schema, store
from bench.evaluate import evaluate
from bench.spec import RunSpec
from bench.store import Store
from envs.scenario import get_scenario
from envs.world import Records, no_episodes

ARCHITECTURE = Architecture((47, 32, 2), "relu", squashed=True)


def network_policy(shield: SafetyGuard | None = None) -> NetworkPolicy:
    """An untrained network, the same every time."""
    torch.manual_seed(5)
    return NetworkPolicy(ARCHITECTURE, ARCHITECTURE.build(), shield=shield)


def risk_policy(scenario: str) -> RiskGuardedPolicy:
    """An untrained network behind an untrained risk model."""
    torch.manual_seed(6)
    size = RiskArchitecture()
    description = {"scenario": get_scenario(scenario).id, "value_mean": 2.0}
    shield = RiskGuard(RiskModel(RiskNetwork(size), size, description))
    plain = network_policy()
    return RiskGuardedPolicy(plain.architecture, plain.network, shield=shield)


_EVALUATED: dict[tuple[str, str, int], Records] = {}


def _evaluated(method: str, policy: Policy, scenario: str, episodes: int) -> Records:
    """Evaluated once in a test run: here a method has one policy."""
    key = (method, scenario, episodes)
    if key not in _EVALUATED:
        _EVALUATED[key] = evaluate(policy, get_scenario(scenario), episodes)
    return _EVALUATED[key]


def write_record(
    results: Path, method: str, policy: Policy, scenario: str = "a", episodes: int = 12,
    change: dict[tuple[int, str], float] | None = None,
) -> Path:  # fmt: skip
    """Evaluate a policy and write the record of it, with figures of the held-out episodes changed afterwards."""
    chosen = get_scenario(scenario)
    spec = RunSpec(
        method=method, method_version=get_method(method).version, scenario=scenario,
        scenario_version=chosen.version, seed=0, steps=0, eval_episodes=episodes,
    )  # fmt: skip
    evaluated = _evaluated(method, policy, scenario, episodes).copy()
    for (number, name), value in (change or {}).items():
        evaluated[name][number] = value
    clock = {"wall_s": 2.0, "cpu_s": 1.5}
    with Store(results).begin(spec) as folder:
        provenance = {"git": {"commit": "0" * 40, "dirty": False}, "packages": {"torch": "2"}, "cpu": "one"}
        folder.write_run(
            {"provenance": provenance, "timing": {"train": clock, "evaluate": clock}, "trains": False, "timeline": []}
        )
        folder.write_policy(policy.save)
        folder.write(store.TRAIN_FILE, schema.to_bytes(schema.episodes_table(no_episodes())))
        folder.write(store.EVAL_FILE, schema.to_bytes(schema.episodes_table(evaluated)))
        folder.write(store.SCALARS_FILE, schema.to_bytes(schema.scalars_table([])))
        folder.finish()
    return folder.path


def reference_policy(method: str, scenario: str = "a") -> Policy:
    """The policy of a driver that does not train."""
    return get_method(method).train(Task(get_scenario(scenario), 0, Budget(5)))

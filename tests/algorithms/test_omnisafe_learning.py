"""OmniSafe's algorithms through our adapter, on tasks whose answer is known."""

import importlib.util

import numpy as np
import pytest
import torch

from algorithms.omnisafe_library import algorithm_defaults
from algorithms.omnisafe_settings import configuration, settings_of
from algorithms.omnisafe_training import Schedule, train_actor
from tests.algorithms.omnisafe_toys import (
    BEST_CONSTRAINED,
    BEST_UNCONSTRAINED,
    BOUND,
    COST_LIMIT,
    HORIZON,
    Push,
)

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("omnisafe") is None, reason="omnisafe is not installed (requirements/omnisafe.txt)"
)
MAIN = ("CPO", "FOCOPS", "TRPOLag")


def toy_configuration(algorithm: str, cost_limit: float, **changes: str) -> dict:
    """Our settings, with networks of the toy's size."""
    settings = settings_of(algorithm).with_changes(changes)
    chosen = configuration(algorithm_defaults(algorithm), settings, cost_limit, gamma=0.95)
    for part in ("actor", "critic"):
        chosen["model_cfgs"][part]["hidden_sizes"] = [32, 32]
    return chosen


def mean_push(network: torch.nn.Sequential) -> float:
    """Mean action over an episode of the deterministic policy."""
    env = Push(1)
    observations, _ = env.reset()
    pushes = []
    for _ in range(HORIZON):
        with torch.no_grad():
            unit = network(torch.as_tensor(observations)).clamp(-1.0, 1.0)
        pushes.append(BOUND * float(unit))
        observations = env.step(BOUND * unit.numpy())[0]
    return float(np.mean(pushes))


@pytest.mark.learning
@pytest.mark.parametrize("algorithm", MAIN)
@pytest.mark.parametrize(("cost_limit", "best"), [(COST_LIMIT, BEST_CONSTRAINED), (50.0, BEST_UNCONSTRAINED)])
def test_the_constrained_optimum_is_reached(algorithm, cost_limit, best):
    changes = {"fisher_every": "2", "multiplier_learning_rate": "0.1", "multiplier_max": "100"}
    network = train_actor(
        algorithm, Push(20), Schedule(20, 100, 50, 0), toy_configuration(algorithm, cost_limit, **changes), seed=3
    )
    assert mean_push(network) == pytest.approx(best, abs=0.1)

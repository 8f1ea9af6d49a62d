"""The hand-written learner learns as the stock one does: same task, same seeds, whole learning curves."""

import numpy as np
import pytest
from stable_baselines3 import SAC

from algorithms.fast_sac import FastSAC, reproducible
from bench.statistics import mean_interval

SEEDS = 5
STEPS = 6_000
"""Thirty episodes of 200 steps; both learners swing up after some fifteen."""


def pendulum_returns(learner, seed):
    with reproducible(seed):
        model = learner(
            "MlpPolicy", "Pendulum-v1", learning_rate=1e-3, learning_starts=400, batch_size=64,
            policy_kwargs={"net_arch": [64, 64]}, seed=seed, device="cpu",
        )  # fmt: skip
        model.learn(STEPS)
    return np.array([episode["r"] for episode in model.ep_info_buffer])


@pytest.mark.slow
def test_on_pendulum_the_difference_of_the_learning_curves_has_an_interval_that_includes_zero():
    stock, fast = (np.stack([pendulum_returns(learner, seed) for seed in range(SEEDS)]) for learner in (SAC, FastSAC))
    assert stock.shape == fast.shape == (SEEDS, STEPS // 200)
    for curves in (stock, fast):
        assert curves[:, :2].mean() < -900.0  # it starts hanging down,
        assert curves[:, -5:].mean() > -400.0  # and ends upright
    for part in (slice(None), slice(-5, None)):
        found = mean_interval(fast[:, part].mean(1) - stock[:, part].mean(1)).interval
        print(f"fast - stock: {found.low:.1f} to {found.high:.1f} of return")
        assert found.low <= 0.0 <= found.high
        learnt_nothing = stock[:, :2].mean() - stock[:, part].mean()
        assert found.low > learnt_nothing, "five seeds do not tell it from a learner that fails"

"""Settings of the OmniSafe baselines, in one place, each with its reason."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from envs.scenario import STEP_S, TIME_LIMIT_S, Scenario, UnknownNameError


@dataclass(frozen=True, slots=True)
class Settings:
    """What a training needs beside its algorithm.

    Attributes:
        worlds: Worlds stepped together, at most; the largest number that divides the budget is taken.
        epoch_decisions: Decisions between two updates, over all worlds.
        batch_size: Mini-batch of the critics, and of first-order actors.
        update_iters: Passes over an epoch's decisions.
        critic_lr: Adam, both critics.
        actor_lr: Adam; first-order algorithms only.
        target_kl: Trust region of second-order algorithms, early stop of first-order ones.
        fvp_sample_freq: Fisher products use every k-th decision; second-order algorithms only.
        cg_iters: Conjugate-gradient iterations; second-order algorithms only.
        lambda_lr: Adam of the Lagrange multiplier; Lagrangian algorithms only.
        lambda_max: Cap of the multiplier, where the algorithm has one.
        focops_lam: Temperature of FOCOPS.
        focops_eta: Trust region per state of FOCOPS.
        gae_lambda: For reward and cost.
        activation: Of all hidden layers.
        actor_hidden: Layers of the actor.
        critic_hidden: Layers of both critics.
    """

    worlds: int = 10
    epoch_decisions: int = 2000
    batch_size: int = 500
    update_iters: int = 5
    critic_lr: float = 1e-3
    actor_lr: float = 3e-4
    target_kl: float = 0.01
    fvp_sample_freq: int = 10
    cg_iters: int = 10
    lambda_lr: float = 0.035
    lambda_max: float = 2.0
    focops_lam: float = 1.5
    focops_eta: float = 0.02
    gae_lambda: float = 0.95
    activation: str = "tanh"
    actor_hidden: tuple[int, ...] = (256,) * 4
    critic_hidden: tuple[int, ...] = (256,) * 3

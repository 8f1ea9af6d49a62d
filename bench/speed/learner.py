"""``bench speed learner``: updates per second of the SAC learner and of stable-baselines3's, side by side."""

from __future__ import annotations

import statistics
import time
from typing import Any, Final

import torch

from algorithms.perceptron import processor_rounds
from algorithms.sac import ACTOR_LAYERS, CRITIC_LAYERS, GAMMA_PER_STEP, LEARNERS, SACSettings
from algorithms.sac_training import LEARNER_CLASSES
from algorithms.sb3_env import StableBaselinesEnv
from bench.provenance import cpu_model, usable_cores
from envs.driving_env import DrivingVectorEnv

UPDATES: Final = 20
"""Updates of one repeat."""
WARM_UP_DECISIONS: Final = 1600
LATER: Final = 4800
"""Updates after which all is measured again, a fifth of a standard training: denormal moments of weights behind ReLUs
that never open have nearly reached the share that they keep (`results/speed/denormals.json`). They slow
stable-baselines3 down; ours counts them as 0 (`algorithms.fast_sac.denormals_are_zero`)."""


def _build(name: str, settings: SACSettings) -> Any:
    """A learner with a filled replay buffer, at the paper's sizes, past its first updates."""
    env = DrivingVectorEnv("a", settings.worlds)
    env.reset(seed=0)
    learner = LEARNER_CLASSES[name](
        "MlpPolicy",
        StableBaselinesEnv(env),
        buffer_size=10_000,
        learning_starts=WARM_UP_DECISIONS,
        batch_size=settings.batch,
        gamma=GAMMA_PER_STEP**env.scenario.substeps,
        train_freq=1,
        gradient_steps=1,
        policy_kwargs={"net_arch": {"pi": list(ACTOR_LAYERS), "qf": list(CRITIC_LAYERS)}},
        seed=0,
        device="cpu",
    )
    return learner.learn(WARM_UP_DECISIONS + 4 * settings.worlds)


BATCHES: Final = (64, 256)
"""The default and stable-baselines3's own, at which others quote their speed."""


def _side_by_side(models: dict[str, Any], updates: int, batch: int, repeats: int) -> dict[str, Any]:
    """Updates per second of processor time, medians over repeats in which the learners take turns."""
    rates: dict[str, list[float]] = {name: [] for name in models}
    for _ in range(repeats):
        for name, model in models.items():
            start = time.process_time()
            model.train(UPDATES, batch)
            rates[name].append(UPDATES / (time.process_time() - start))

    def median(name: str) -> float | None:
        return statistics.median(rates[name]) if name in rates else None

    def ratio(name: str) -> float | None:
        if name not in rates:
            return None
        return statistics.median(ours / stock for ours, stock in zip(rates[name], rates["sb3"], strict=True))

    return {
        "after_updates": updates,
        "batch": batch,
        "sb3_updates_per_s": median("sb3"),
        "fp32_updates_per_s": median("fast"),
        "bf16_updates_per_s": median("bf16"),
        "ratio_fp32": ratio("fast"),
        "ratio_bf16": ratio("bf16"),
    }


def learner(repeats: int = 7) -> dict[str, Any]:
    """Updates per second side by side, one torch thread; None for bfloat16 where the processor lacks it.

    ``at`` has those of fresh learners and of learners after `LATER` updates, for both batches; the figures at the top
    are those after `LATER` updates for batches of 256.
    """
    torch.set_num_threads(1)
    settings = SACSettings()
    names = [name for name in LEARNERS if name != "bf16" or processor_rounds()]
    models = {name: _build(name, settings) for name in names}
    found = [_side_by_side(models, 0, batch, repeats) for batch in BATCHES]
    for model in models.values():
        model.train(LATER, settings.batch)
    found += [_side_by_side(models, LATER, batch, repeats) for batch in BATCHES]
    return {
        **found[-1],
        "at": found,
        "actor_layers": list(ACTOR_LAYERS),
        "critic_layers": list(CRITIC_LAYERS),
        "repeats": repeats,
        "amx": bool(torch.cpu._is_amx_tile_supported()),
        "cpu": cpu_model(),
        "usable_cores": usable_cores(),
    }


def as_text(measured: dict[str, Any]) -> str:
    """The figures for people."""
    lines = [f"SAC updates per second of processor time, one thread, medians of {measured['repeats']} repeats, "
             f"{measured['cpu']}"]  # fmt: skip
    for found in measured["at"]:
        half = "no bf16" if found["ratio_bf16"] is None else f"bf16 {found['bf16_updates_per_s']:.1f}"
        times = "" if found["ratio_bf16"] is None else f" ({found['ratio_bf16']:.2f} times)"
        lines.append(
            f"after {found['after_updates']:>5,} updates, batch {found['batch']:>3}   "
            f"stable-baselines3 {found['sb3_updates_per_s']:.1f}   "
            f"fp32 {found['fp32_updates_per_s']:.1f} ({found['ratio_fp32']:.2f} times)   {half}{times}"
        )
    return "\n".join(lines)

"""``bench speed learner``: updates per second of the SAC learner and of stable-baselines3's, side by side."""

from __future__ import annotations

import statistics
import time
from typing import Any, Final

import torch

from algorithms.sac import ACTOR_LAYERS, CRITIC_LAYERS, GAMMA_PER_STEP, LEARNERS, SACSettings
from algorithms.sb3_env import StableBaselinesEnv
from bench.provenance import cpu_model, usable_cores
from envs.driving_env import DrivingVectorEnv

UPDATES: Final = 20
"""Updates of one repeat."""
WARM_UP_DECISIONS: Final = 1600


def _build(name: str, settings: SACSettings) -> Any:
    """A learner with a filled replay buffer, at the paper's sizes, past its first updates."""
    env = DrivingVectorEnv("a", settings.worlds)
    env.reset(seed=0)
    learner = LEARNERS[name](
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


def learner(repeats: int = 7) -> dict[str, Any]:
    """Medians over repeats in which both learners take turns, one torch thread, fp32."""
    torch.set_num_threads(1)
    settings = SACSettings()
    models = {name: _build(name, settings) for name in ("fast", "sb3")}
    wall: dict[str, list[float]] = {name: [] for name in models}
    cpu: dict[str, list[float]] = {name: [] for name in models}
    for _ in range(repeats):
        for name, model in models.items():
            start, start_cpu = time.perf_counter(), time.process_time()
            model.train(UPDATES, settings.batch)
            wall[name].append(UPDATES / (time.perf_counter() - start))
            cpu[name].append(UPDATES / (time.process_time() - start_cpu))
    ratios = [fast / stock for fast, stock in zip(cpu["fast"], cpu["sb3"], strict=True)]
    return {
        "batch": settings.batch,
        "actor_layers": list(ACTOR_LAYERS),
        "critic_layers": list(CRITIC_LAYERS),
        "repeats": repeats,
        "updates_per_s": statistics.median(wall["fast"]),
        "updates_per_s_sb3": statistics.median(wall["sb3"]),
        "updates_per_cpu_s": statistics.median(cpu["fast"]),
        "updates_per_cpu_s_sb3": statistics.median(cpu["sb3"]),
        "ratio_vs_sb3": statistics.median(ratios),
        "bf16_on_this_cpu": bool(torch.ops.mkldnn._is_mkldnn_bf16_supported()),
        "cpu": cpu_model(),
        "usable_cores": usable_cores(),
    }


def as_text(measured: dict[str, Any]) -> str:
    """The figures for people."""
    return (
        f"SAC update, batch {measured['batch']}, one thread, medians of {measured['repeats']} repeats, "
        f"{measured['cpu']}\n"
        f"this learner        {measured['updates_per_s']:>8.1f} updates/s\n"
        f"stable-baselines3   {measured['updates_per_s_sb3']:>8.1f} updates/s "
        f"(this learner: {measured['ratio_vs_sb3']:.2f} times, by processor time)"
    )

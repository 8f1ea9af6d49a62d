"""``bench speed risk``: time of the risk model for a batch of scenes, compiled and as the plain network."""

from __future__ import annotations

import statistics
import time
from typing import Any, Final

import numpy as np
import torch

from algorithms.risk_model import RiskArchitecture, RiskModel, RiskNetwork
from bench.provenance import cpu_model, usable_cores
from envs.driving_env import DrivingVectorEnv, action_space

WORLDS: Final = (64, 256)
"""Of training and of evaluation."""
CALLS: Final = 20
"""Calls of one repeat."""
WARM_UP_DECISIONS: Final = 20


def _scenes(worlds: int) -> np.ndarray:
    """Observations (worlds, 47) of scenario a some seconds after the start, under random actions."""
    env = DrivingVectorEnv("a", worlds)
    observations, _ = env.reset(seed=0)
    space, rng = action_space(env.action_mode), np.random.default_rng(0)
    for _ in range(WARM_UP_DECISIONS):
        observations = env.step(rng.uniform(space.low, space.high, (worlds, len(space.low))))[0]
    return observations


def risk(repeats: int = 7) -> dict[str, Any]:
    """Medians over repeats in which both forms take turns, by processor time, on one thread.

    The weights are untrained: time does not depend on them.
    """
    torch.set_num_threads(1)
    torch.manual_seed(0)
    size = RiskArchitecture()
    model = RiskModel(RiskNetwork(size), size, {})
    figures: dict[str, Any] = {"repeats": repeats}
    for worlds in WORLDS:
        scenes = _scenes(worlds)
        model(scenes)
        times: dict[str, list[float]] = {"compiled": [], "plain": []}
        for _ in range(repeats):
            start = time.process_time()
            for _ in range(CALLS):
                model(scenes)
            between = time.process_time()
            for _ in range(CALLS):
                model.network(torch.from_numpy(scenes))
            times["compiled"].append((between - start) / CALLS)
            times["plain"].append((time.process_time() - between) / CALLS)
        figures[f"ms_{worlds}_worlds"] = 1e3 * statistics.median(times["compiled"])
        figures[f"plain_ms_{worlds}_worlds"] = 1e3 * statistics.median(times["plain"])
    return {**figures, "cpu": cpu_model(), "usable_cores": usable_cores()}


def as_text(measured: dict[str, Any]) -> str:
    """The figures for people."""
    lines = [f"risk model, medians of {measured['repeats']} repeats, one thread, {measured['cpu']}"]
    for worlds in WORLDS:
        compiled, plain = measured[f"ms_{worlds}_worlds"], measured[f"plain_ms_{worlds}_worlds"]
        lines.append(f"{worlds:>4} worlds  {compiled:8.2f} ms, plain network {plain:.2f} ms")
    return "\n".join(lines)

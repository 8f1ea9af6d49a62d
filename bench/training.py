"""Artefacts that runs share, trained by themselves: ``bench train``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from algorithms.driving_agent import DrivingAgentSpec, driving_agent
from bench.errors import UsageError
from envs.plugins import UnavailableError


def train_driving_agent(scenario: str, steps: int, cache: Path, say: Callable[[str], None]) -> Path:
    """Folder of the driving agent, trained now or found in the cache.

    Raises:
        UsageError: The scenario is unknown, or the budget does not fit it.
    """

    def report(done: int, scalars: Mapping[str, float]) -> None:
        shown = ("return", "collision_rate", "speed_mps")
        say(f"{done:9,} steps  " + "  ".join(f"{key} {scalars[key]:.2f}" for key in shown if key in scalars))

    try:
        spec = DrivingAgentSpec(scenario, steps)
        driving_agent(spec, cache, report)
    except (ValueError, UnavailableError) as error:
        raise UsageError(str(error)) from error
    return cache / spec.key

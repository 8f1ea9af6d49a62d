"""One training of an OmniSafe algorithm within a budget, to the decision."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from gymnasium.vector import VectorEnv

from algorithms.omnisafe_env import known_to_omnisafe
from algorithms.omnisafe_library import close_logger, omnisafe_module, process_state_kept
from algorithms.omnisafe_speed import fast_loops

Progress = Callable[[Mapping[str, float]], None]


@dataclass(frozen=True, slots=True)
class Schedule:
    """How a budget is spent: epochs x steps x worlds decisions, and a rest that no update can use.

    Attributes:
        worlds: Worlds stepped together.
        epochs: Roll-outs, each followed by an update.
        steps: Decisions of each world in an epoch, not fewer than the longest episode: each epoch then sees an
            episode end, and its mean cost is a number.
        rest: Decisions of each world after the last update.
    """

    worlds: int
    epochs: int
    steps: int
    rest: int


def plan(decisions: int, longest_episode: int, worlds: int, epoch_decisions: int) -> Schedule:
    """Spend a budget exactly, with epochs near the wanted size.

    Args:
        decisions: The budget.
        longest_episode: Decisions until an episode ends at the latest.
        worlds: At most so many.
        epoch_decisions: Wanted decisions in an epoch, over all worlds.

    Raises:
        ValueError: The budget is shorter than the longest episode.
    """
    if decisions < longest_episode:
        raise ValueError(
            f"A budget of {decisions} decisions is too small: on-policy training needs at least the longest "
            f"episode, {longest_episode} decisions."
        )
    worlds = max(n for n in range(1, worlds + 1) if decisions % n == 0 and decisions // n >= longest_episode)
    each = decisions // worlds
    wanted = max(1, round(decisions / max(epoch_decisions, longest_episode * worlds)))
    most = min(each // longest_episode, math.ceil(1.25 * wanted))
    epochs = min(
        range(max(1, math.floor(0.75 * wanted)), most + 1), key=lambda n: (each % n, abs(n - wanted))
    )
    return Schedule(worlds, epochs, each // epochs, each % epochs)


def train_actor(
    algorithm: str,
    vector: VectorEnv[Any, Any, Any],
    schedule: Schedule,
    configuration: Mapping[str, Any],
    seed: int,
    progress: Progress = lambda _scalars: None,
) -> torch.nn.Sequential:
    """Train by OmniSafe's own implementation; the mean network, from observation to action in [-1, 1], unclipped.

    Args:
        algorithm: Name in OmniSafe.
        vector: The environment, with SAME_STEP autoreset and ``cost`` in info.
        schedule: Its worlds are those of the environment.
        configuration: OmniSafe's custom configuration without what the schedule says.
        seed: For networks and exploration, 32 bits.
        progress: Called with scalars at the start of every epoch and at the end.

    Raises:
        UnavailableMethodError: OmniSafe cannot be imported.
    """
    trainer: Any = None

    def epoch_begins() -> None:
        if trainer is not None:
            progress(_epoch_scalars(trainer))

    with (
        process_state_kept(),
        fast_loops(),
        known_to_omnisafe(vector, epoch_begins) as environment,
        tempfile.TemporaryDirectory() as folder,
    ):
        chosen = _with_schedule(configuration, schedule, seed, Path(folder))
        trainer = omnisafe_module().Agent(algorithm, environment, custom_cfgs=chosen).agent
        try:
            trainer.learn()
            _spend_rest(trainer, schedule.rest)
            progress(_epoch_scalars(trainer))
        finally:
            close_logger(trainer.logger)
    network: torch.nn.Sequential = trainer._actor_critic.actor.mean[:-1]  # without the identity at its end
    return network


def _epoch_scalars(trainer: Any) -> dict[str, float]:
    """What the last update saw: mean cost of the last 50 finished episodes, Lagrange multiplier."""
    scalars = {}
    costs = trainer.logger._data["Metrics/EpCost"]
    if costs:
        scalars["episode_cost"] = sum(costs) / len(costs)
    lagrange = getattr(trainer, "_lagrange", None)
    if lagrange is not None:
        scalars["multiplier"] = float(torch.as_tensor(lagrange.lagrangian_multiplier).detach())
    return scalars


def _with_schedule(
    configuration: Mapping[str, Any], schedule: Schedule, seed: int, folder: Path
) -> dict[str, Any]:
    size = schedule.worlds * schedule.steps
    train = {"vector_env_nums": schedule.worlds, "total_steps": size * schedule.epochs}
    return {
        **configuration,
        "seed": seed,
        "train_cfgs": {**configuration["train_cfgs"], **train},
        "algo_cfgs": {**configuration["algo_cfgs"], "steps_per_epoch": size},
        "logger_cfgs": {**configuration["logger_cfgs"], "log_dir": str(folder)},
    }


def _spend_rest(trainer: Any, steps: int) -> None:
    """Drive on with the trained, still exploring policy, so that the budget is used to the decision."""
    if steps == 0:
        return
    observations, _ = trainer._env.reset()
    for _ in range(steps):
        with torch.no_grad():
            actions = trainer._actor_critic.actor.predict(observations)
        observations = trainer._env.step(actions)[0]

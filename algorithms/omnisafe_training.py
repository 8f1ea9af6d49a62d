"""A training of an OmniSafe algorithm on our scenarios."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping
from typing import Any

import torch
from gymnasium.vector import VectorEnv

from algorithms.checkpoints import Checkpoints
from algorithms.method import Task
from algorithms.networks import Architecture, NetworkPolicy
from algorithms.omnisafe_checkpoint import capture, restore
from algorithms.omnisafe_env import known_to_omnisafe
from algorithms.omnisafe_library import algorithm_defaults, close_logger, omnisafe_module, process_state_kept
from algorithms.omnisafe_settings import ACTIVATION, configuration, plan, settings_of
from algorithms.omnisafe_speed import fast_loops
from algorithms.sac import ACTOR_LAYERS, GAMMA_PER_STEP
from algorithms.sac_training import training_scalars
from envs.driving_env import DrivingVectorEnv, action_space
from envs.observation import OBSERVATION_SIZE
from envs.scenario import STEP_S, TIME_LIMIT_S, Scenario

Progress = Callable[[Mapping[str, float]], None]


def longest_episode(scenario: Scenario) -> int:
    """Decisions until an episode ends at the latest."""
    return math.ceil(TIME_LIMIT_S / (STEP_S * scenario.substeps) - 1e-9)


def train(algorithm: str, task: Task) -> NetworkPolicy:
    """Train within the task's budget and return the deterministic policy.

    Raises:
        UnavailableMethodError: OmniSafe cannot be imported.
        ValueError: The budget is shorter than the longest episode, or a setting is malformed.
    """
    settings = settings_of(algorithm).with_changes(task.settings)
    chosen = plan(task.budget.decisions(task.scenario), longest_episode(task.scenario), settings)
    custom = configuration(
        algorithm_defaults(algorithm),
        settings,
        chosen,
        cost_limit=task.cost_limit,
        gamma=GAMMA_PER_STEP**task.scenario.substeps,
        seed=task.torch_seed(),
    )
    env = task.make_env(chosen.worlds)

    def progress(scalars: Mapping[str, float]) -> None:
        task.progress(env.steps_done, {**training_scalars(env), **scalars})

    trained = train_actor(algorithm, env, custom, chosen.rest, progress, task.checkpoints)
    architecture = Architecture(
        (OBSERVATION_SIZE, *ACTOR_LAYERS, action_space(env.action_mode).shape[0]), ACTIVATION, squashed=False
    )
    return NetworkPolicy(architecture, trained)


def train_actor(
    algorithm: str,
    vector: VectorEnv[Any, Any, Any],
    configuration: Mapping[str, Any],
    rest: int = 0,
    progress: Progress = lambda _scalars: None,
    checkpoints: Checkpoints | None = None,
) -> torch.nn.Sequential:
    """Train by OmniSafe's own implementation; the mean network, from observation to action in [-1, 1], unclipped.

    Args:
        algorithm: Name in OmniSafe.
        vector: The environment, with SAME_STEP autoreset and ``cost`` in info.
        configuration: OmniSafe's custom configuration, but for the folder of its log.
        rest: Decisions of each world after the last update.
        progress: Called with scalars at the start of every epoch and at the end.
        checkpoints: Where to keep the state at the end of an epoch; the environment must be one of ours then.

    Raises:
        UnavailableMethodError: OmniSafe cannot be imported.
    """
    trainer: Any = None

    def epoch_begins() -> None:
        if trainer is not None:
            if checkpoints is not None and isinstance(vector, DrivingVectorEnv) and checkpoints.due(vector.steps_done):
                checkpoints.save(vector.steps_done, capture(trainer, vector))
            progress(_epoch_scalars(trainer))

    with (
        process_state_kept(),
        fast_loops(),
        known_to_omnisafe(vector, epoch_begins) as environment,
        tempfile.TemporaryDirectory() as folder,
    ):
        chosen = {**configuration, "logger_cfgs": {**configuration["logger_cfgs"], "log_dir": folder}}
        trainer = omnisafe_module().Agent(algorithm, environment, custom_cfgs=chosen).agent
        before = None if checkpoints is None else checkpoints.load()
        if before is not None and isinstance(vector, DrivingVectorEnv):
            restore(trainer, vector, before)
        try:
            trainer.learn()
            _spend_rest(trainer, rest)
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


def _spend_rest(trainer: Any, steps: int) -> None:
    """Drive on with the trained, still exploring policy, so that the budget is used to the decision."""
    if steps == 0:
        return
    observations, _ = trainer._env.reset()
    for _ in range(steps):
        with torch.no_grad():
            actions = trainer._actor_critic.actor.predict(observations)
        observations = trainer._env.step(actions)[0]

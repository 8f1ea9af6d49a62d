"""Roll-outs of the driving agent on worlds that no model was trained on, with what each model said of every scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import special

from algorithms.method import Policy, seed_sequence
from algorithms.risk_model import RiskModel, risk_percent
from algorithms.risk_training import (
    CONTACT,
    PLANNING_TIME,
    contact_steps,
    contact_within,
    decisions_ahead,
    randomised,
)
from envs.driving_env import DrivingVectorEnv
from envs.layout import EpisodeSource
from envs.reward import path_exposure
from envs.scenario import Scenario
from envs.world import BoolArray, FloatArray, World

WORLDS: Final = 256
DECISIONS: Final = 400
"""Of each world: 200 s, some four episodes."""
METHODS: Final[Mapping[str, str]] = {PLANNING_TIME: "dd-rq", CONTACT: "dd-rq-plus"}
"""Which method uses the model of a label."""


@dataclass(frozen=True, slots=True)
class Rollouts:
    """Scenes at decisions of the driving agent, in order of time, and what followed.

    Attributes:
        episodes: Number of the episode of each scene, shape (M,).
        planning_times: T_c that the agent chose, shape (M,) [s].
        values: What each model gave, by method: T_c [s], or the logit of contact within 3 s; shape (M,).
        inverse_ttc: 1 / time to collision with what is ahead in the ego's path, 0 where nothing closes in, (M,) [1/s].
        contact: Whether contact followed within 3 s, shape (M,).
    """

    episodes: npt.NDArray[np.int64]
    planning_times: FloatArray
    values: Mapping[str, FloatArray]
    inverse_ttc: FloatArray
    contact: BoolArray

    def risk(self, method: str) -> FloatArray:
        """RQ of the method's model, shape (M,) [%]."""
        return risk_of(method, self.values[method])


def risk_of(method: str, values: FloatArray) -> FloatArray:
    """RQ [%] of a model's values, as the method's guard takes it."""
    if method == METHODS[CONTACT]:
        probability: FloatArray = special.expit(values)
        return 100.0 * probability
    return risk_percent(values)


def report_source(scenario: Scenario) -> EpisodeSource:
    """The report's own episodes: randomised traffic as in training, neither its worlds nor the held-out ones."""
    variant = randomised(scenario)
    return EpisodeSource(variant, seed_sequence("risk report", variant.id))


def inverse_time_to_collision(world: World) -> FloatArray:
    """1 / TTC of every ego, shape (N,) [1/s]; 0 where nothing ahead in its path comes nearer."""
    exposures = (path_exposure(world.ego, world.vehicles, world.pedestrians, i)[1] for i in range(len(world)))
    return 1.0 / np.maximum(np.fromiter(exposures, np.float64, len(world)), 1e-2)


def roll_out(
    agent: Policy, models: Mapping[str, RiskModel], scenario: Scenario, worlds: int = WORLDS, decisions: int = DECISIONS
) -> Rollouts:
    """Drive the agent, without a guard, and keep every scene whose next 3 s are known.

    Args:
        agent: The driving agent whose risk the models quantify.
        models: By method.
        scenario: What they were trained for.
        worlds: Driven at a time.
        decisions: Scenes of each world.
    """
    source = report_source(scenario)
    env = DrivingVectorEnv(source.scenario, worlds, source=source, action_mode=agent.action_mode, comfort=False)
    observations, _ = env.reset()
    ahead = decisions_ahead(scenario)
    episodes, times, inverse, contacts, ends = [], [], [], [], []
    values: dict[str, list[FloatArray]] = {method: [] for method in models}
    for _ in range(decisions + ahead - 1):
        actions = agent.act(observations)
        episodes.append(env.world.episode["episode"].copy())
        times.append(actions[:, 0].astype(np.float64))
        inverse.append(inverse_time_to_collision(env.world))
        for method, model in models.items():
            values[method].append(model(observations).value)
        observations, _, terminated, truncated, info = env.step(actions)
        ends.append(terminated | truncated)
        contacts.append(contact_steps(info, ends[-1], scenario.substeps))
    contact = contact_within(np.array(contacts), np.array(ends), scenario.substeps)
    return Rollouts(
        np.concatenate(episodes[:decisions]),
        np.concatenate(times[:decisions]),
        {method: np.concatenate(series[:decisions]) for method, series in values.items()},
        np.concatenate(inverse[:decisions]),
        contact[:decisions].reshape(-1),
    )

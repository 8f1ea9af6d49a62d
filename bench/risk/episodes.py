"""Single episodes of the driving agent, with RQ and importance at every step, for the pictures of a report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from algorithms.method import Policy
from algorithms.risk_guard import place_importance
from algorithms.risk_model import RiskModel
from bench.errors import UsageError
from bench.risk.rollouts import report_source, risk_of
from envs.batch import observe
from envs.observation import OBSERVATION_SIZE
from envs.scenario import Scenario
from envs.trace import EpisodeTrace, record_episode
from envs.world import Ending, FloatArray, World

SEARCHED: Final = 200
"""Episodes among which the shown ones are found: the first of each ending."""


@dataclass(frozen=True, slots=True)
class RiskEpisode:
    """An episode of T steps and what the models said of its T + 1 states.

    Attributes:
        trace: The episode.
        risk: RQ by method, shape (T + 1,) [%].
        importance: IR of vehicles, then pedestrians, by method, shape (T + 1, V + P).
    """

    trace: EpisodeTrace
    risk: Mapping[str, FloatArray]
    importance: Mapping[str, FloatArray]


def first_ending(agent: Policy, models: Mapping[str, RiskModel], scenario: Scenario, ending: Ending) -> RiskEpisode:
    """The first episode of the report's stream that ends so.

    Raises:
        UsageError: None of the first 200 does.
    """
    source = report_source(scenario)
    for number in range(SEARCHED):
        trace = record_episode(source, number, agent.act, action_mode=agent.action_mode, comfort=False)
        if trace.episode["ending"][-1] == ending:
            return _look(trace, models)
    raise UsageError(f"None of {SEARCHED} episodes of {scenario.id} ended in {ending.name.lower()}.")


def _look(trace: EpisodeTrace, models: Mapping[str, RiskModel]) -> RiskEpisode:
    states = World(trace.ego, trace.vehicles, trace.pedestrians, trace.episode)
    count = len(states)
    observations = np.zeros((count, OBSERVATION_SIZE), np.float32)
    every = np.arange(count)
    observe(states.ego, states.vehicles, states.pedestrians, np.ones(count, np.bool_), every, observations)
    risk, importance = {}, {}
    for method, model in models.items():
        output = model(observations)
        risk[method] = risk_of(method, output.value)
        placed = np.empty((count, states.vehicles.shape[1] + states.pedestrians.shape[1]))
        place_importance(states.ego, states.vehicles, states.pedestrians, output.importance, placed)
        importance[method] = placed
    return RiskEpisode(trace, risk, importance)

"""Stage A: a policy, deterministic, on the held-out episodes of a scenario."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from algorithms.method import Policy, seed_sequence
from envs.driving_env import CostSignal, DrivingVectorEnv
from envs.layout import EpisodeSource, held_out_source
from envs.scenario import Scenario
from envs.world import Records, Shield

WORLDS: Final = 256
"""Worlds stepped together. Fixed: the rounding of a network's products depends on the size of its batch."""


def evaluate(
    policy: Policy,
    scenario: Scenario,
    episodes: int,
    worlds: int = WORLDS,
    cost_signal: CostSignal = CostSignal.COLLISION,
    progress: Callable[[int], None] = lambda _done: None,
) -> Records:
    """Drive the held-out episodes 0 to episodes - 1, shield on, until every one has ended.

    Args:
        policy: Its `shield` and `action_mode` are honoured.
        scenario: What is driven; it decides the held-out list.
        episodes: How many of the list.
        worlds: Worlds stepped together.
        cost_signal: What costs 1 in the records.
        progress: Called with the number of episodes that have ended, each time that it changes.

    Returns:
        `EPISODE` records, shape (episodes,), in order of episode number.

    Raises:
        ValueError: The policy gave an action that is not finite or of the wrong shape.
        MutatedObservationError: It wrote into its observations.
        RuntimeError: An episode is missing or came twice.
    """
    env = evaluation_env(policy, worlds, held_out_source(scenario, episodes), cost_signal)
    observations, _ = env.reset()
    begin_evaluation(policy, worlds, scenario)
    while env.active.any():
        observations, _, _, _, info = env.step(policy.act(observations))
        if "finished" in info:
            progress(env.episodes_done)
    return _in_order(env.finished_episodes(), episodes)


def evaluation_env(
    policy: Policy, worlds: int, source: EpisodeSource, cost_signal: CostSignal, shield: Shield | None = None
) -> DrivingVectorEnv:
    """The worlds in which a policy is evaluated, behind its own shield or a stand-in that answers the same."""
    return DrivingVectorEnv(
        source.scenario,
        worlds,
        shield=shield or policy.shield,
        action_mode=policy.action_mode,
        comfort=True,
        cost_signal=cost_signal,
        source=source,
        watched=True,
    )


def begin_evaluation(policy: Policy, worlds: int, scenario: Scenario) -> None:
    """Seed a policy, and its shield, for the held-out list."""
    policy.begin(worlds, seed_sequence("evaluation", scenario.id))


def _in_order(records: Records, episodes: int) -> Records:
    ordered: Records = records[np.argsort(records["episode"], kind="stable")]
    if not np.array_equal(ordered["episode"], np.arange(episodes)):
        raise RuntimeError(f"Held-out episodes 0 to {episodes - 1} did not each end exactly once.")
    return ordered

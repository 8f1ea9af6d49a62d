"""Stress of a guard: careless drivers in very many episodes, each collision counted by its kind and replayable."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from algorithms.guard_options import GuardOptions
from algorithms.method import Actions, Observations, seed_sequence
from algorithms.risk_guard import RiskGuard
from algorithms.risk_training import risk_model
from algorithms.safety_guard import SafetyGuard
from algorithms.scripted_policies import DRIVERS
from bench.errors import UsageError
from bench.stress_result import DD_RQ, StressResult, Tc, Totals
from envs.driving_env import ActionMode, DrivingVectorEnv, action_space
from envs.engine import STEPS_MAX
from envs.layout import CHUNK, EpisodeSource
from envs.motion import ACCELERATION_MAX_MPS2
from envs.plugins import UnavailableError
from envs.scenario import LANE_WIDTH_M, Scenario, UnknownNameError, get_scenario
from envs.trace import EpisodeTrace, record_episode
from envs.world import FloatArray, Records, Shield

RANDOM: Final = "random"
CRUISE: Final = "cruise"
FULL_THROTTLE: Final = "full-throttle"
FULL_THROTTLE_LANE_CHANGE: Final = "full-throttle-lane-change"
STRESS_DRIVERS: Final = (RANDOM, CRUISE, FULL_THROTTLE, FULL_THROTTLE_LANE_CHANGE)
WISH_S: Final = 3.0
"""How long `full-throttle-lane-change` holds one wish: a lane to the right, stay, a lane to the left."""

OPTION_NAMES: Final = tuple(field.name for field in dataclasses.fields(GuardOptions))
ShieldFactory = Callable[[Scenario], Shield]

BATCH: Final = 16 * CHUNK
"""Episodes whose records are held at once."""
WORLDS: Final = 256
"""Worlds stepped together. No answer of our guards depends on it; a replay steps as many, as another shield's may."""
_DRAWS_KEPT: Final = 4


class StressDriver:
    """A driver whose every draw belongs to an episode and a decision in it.

    So an episode is the same in whichever world, batch or replay it runs.

    Attributes:
        name: One of `STRESS_DRIVERS`.

    Raises:
        UnknownNameError: There is no such driver.
    """

    def __init__(self, name: str, scenario: Scenario, seed: int) -> None:
        """Choose a driver and the seed of its draws."""
        if name not in STRESS_DRIVERS:
            raise UnknownNameError("stress driver", name, list(STRESS_DRIVERS))
        self.name = name
        self._seed = seed
        self._substeps = scenario.substeps
        self._hold = max(1, round(WISH_S / scenario.decision_period_s))
        self._scripted = DRIVERS[name]() if name in (CRUISE, FULL_THROTTLE) else None
        self._space = action_space(ActionMode.ACCELERATION)
        self._chunks: dict[int, FloatArray] = {}

    def act(self, observations: Observations, episodes: Records) -> Actions:
        """Actions (N, 2) [m, m/s2] for observations (N, 47) and the worlds' `EPISODE` records (N,)."""
        if self._scripted is not None:
            return self._scripted.act(observations)
        decisions = episodes["steps"] // self._substeps
        if self.name == RANDOM:
            share = self._draws(episodes["episode"], decisions)
            return self._space.low + (self._space.high - self._space.low) * share
        share = self._draws(episodes["episode"], decisions // self._hold)[:, 0]
        wish = (np.floor(3.0 * share) - 1.0) * LANE_WIDTH_M
        return np.column_stack([wish, np.full(len(wish), ACCELERATION_MAX_MPS2)])

    def _draws(self, numbers: npt.NDArray[np.int64], decisions: npt.NDArray[np.int64]) -> FloatArray:
        """Two uniform numbers in [0, 1) for each (episode, decision), shape (N, 2)."""
        chunks, rows = np.divmod(numbers, CHUNK)
        result = np.empty((len(numbers), 2))
        for chunk in np.unique(chunks):
            member = chunks == chunk
            result[member] = self._chunk(int(chunk))[rows[member], decisions[member]]
        return result

    def _chunk(self, index: int) -> FloatArray:
        if index not in self._chunks:
            if len(self._chunks) == _DRAWS_KEPT:
                del self._chunks[min(self._chunks)]
            rng = np.random.default_rng(seed_sequence("stress-driver", self._seed, index))
            self._chunks[index] = rng.random((CHUNK, STEPS_MAX // self._substeps + 1, 2))
        return self._chunks[index]


def stress_source(scenario: Scenario, seed: int, start: int = 0, stop: int | None = None) -> EpisodeSource:
    """The stress test's own episodes: neither training's nor the held-out ones."""
    return EpisodeSource(scenario, seed_sequence("stress", scenario.id, seed), start, stop)


def make_shield(
    scenario: Scenario, tc: Tc, options: GuardOptions | None, shield_factory: ShieldFactory | None
) -> Shield:
    """The guard of a T_c, or what the factory makes.

    Raises:
        ValueError: T_c is not a positive number, or needs a factory that is not given.
    """
    if shield_factory is not None:
        return shield_factory(scenario)
    if isinstance(tc, str):
        raise ValueError(
            f"tc = {tc!r}: a T_c set by a risk model needs a trained one; pass shield_factory, "
            "which builds its shield for a scenario, or give T_c as a number of seconds."
        )
    return SafetyGuard(tc, options)


def stress_guard(
    scenario: str | Scenario, tc: Tc, episodes: int, driver: str = RANDOM, options: GuardOptions | None = None,
    worlds: int = WORLDS, seed: int = 0, shield_factory: ShieldFactory | None = None, agent_steps: int | None = None,
) -> StressResult:  # fmt: skip
    """Drive many episodes behind a guard and count what happens.

    Args:
        scenario: Where; a name with parameters, or the value.
        tc: T_c [s], or ``dd-rq`` together with a factory.
        episodes: How many, at least 1.
        driver: One of `STRESS_DRIVERS`.
        options: Readings of Alg. 2; the defaults where None.
        worlds: Driven at a time; no result depends on it.
        seed: Names the stream of episodes and the driver's draws.
        shield_factory: Makes another shield than `SafetyGuard` of T_c; one that does not depend on past steps.
        agent_steps: Noted in the result: the budget behind a factory's risk model.

    Raises:
        ValueError: A number is out of range, or T_c is unusable.
        UnknownNameError: The scenario or the driver is unknown.
    """
    scenario = get_scenario(scenario) if isinstance(scenario, str) else scenario
    if episodes < 1:
        raise ValueError(f"episodes = {episodes}: must be at least 1.")
    shield = make_shield(scenario, tc, options, shield_factory)
    policy = StressDriver(driver, scenario, seed)
    totals = Totals()
    for start in range(0, episodes, BATCH):
        source = stress_source(scenario, seed, start, min(start + BATCH, episodes))
        totals.add(_drive(source, policy, shield, min(worlds, episodes - start)))
    used = dataclasses.asdict(shield.options) if isinstance(shield, SafetyGuard) else {}
    return totals.result(scenario=scenario.id, tc=tc, driver=driver, seed=seed, agent_steps=agent_steps, options=used)


def parse_options(settings: Sequence[str]) -> GuardOptions:
    """Guard options from texts such as ``reserve=false``; the defaults for the rest.

    Raises:
        ValueError: An option is unknown, or its value neither true nor false.
    """
    changes = {}
    for item in settings:
        key, _, text = item.partition("=")
        if key not in OPTION_NAMES:
            raise UnknownNameError("guard option", key, list(OPTION_NAMES))
        if text not in ("true", "false"):
            raise ValueError(f"Guard option {item!r}: expected {key}=true or {key}=false.")
        changes[key] = text == "true"
    return GuardOptions(**changes)


def command(
    scenario: str, tc: str, episodes: int, driver: str, seed: int, agent_steps: int, cache: Path,
    settings: Sequence[str] = (),
) -> StressResult:  # fmt: skip
    """`stress_guard` from what is typed: T_c as a text, DD-RQ's risk model from the cache or trained now.

    Raises:
        UsageError: A name is unknown or a number unusable.
    """
    try:
        chosen, options = get_scenario(scenario), parse_options(settings)
        if tc != DD_RQ:
            return stress_guard(chosen, float(tc), episodes, driver, options, seed=seed)
        model = risk_model(chosen, agent_steps, cache)
        return stress_guard(
            chosen, DD_RQ, episodes, driver, seed=seed, agent_steps=agent_steps,
            shield_factory=lambda _scenario: RiskGuard(model, options=options),
        )  # fmt: skip
    except (ValueError, UnavailableError) as error:
        raise UsageError(str(error)) from error


def _drive(source: EpisodeSource, driver: StressDriver, shield: Shield, worlds: int) -> Records:
    """`EPISODE` records of all episodes of a source that ends, in order of their numbers."""
    env = DrivingVectorEnv(source.scenario, worlds, source=source, shield=shield)
    observations, _ = env.reset()
    while env.active.any():
        observations = env.step(driver.act(observations, env.world.episode))[0]
    finished = env.finished_episodes()
    return finished[np.argsort(finished["episode"])]


def replay_stress(
    scenario: str | Scenario, tc: Tc, driver: str, episode: int, options: GuardOptions | None = None,
    seed: int = 0, shield_factory: ShieldFactory | None = None,
) -> EpisodeTrace:  # fmt: skip
    """Drive one episode of `stress_guard` again, bit for bit, and keep every step of it.

    Raises:
        ValueError: The episode's number is negative, or T_c is unusable.
        UnknownNameError: The scenario or the driver is unknown.
    """
    scenario = get_scenario(scenario) if isinstance(scenario, str) else scenario
    policy = StressDriver(driver, scenario, seed)
    record = np.zeros(WORLDS, [("episode", "i8"), ("steps", "i8")])
    record["episode"] = episode

    def act(observations: Observations) -> Actions:
        actions = policy.act(observations, record)
        record["steps"] += scenario.substeps
        return actions

    shield = make_shield(scenario, tc, options, shield_factory)
    return record_episode(stress_source(scenario, seed), episode, act, worlds=WORLDS, shield=shield)

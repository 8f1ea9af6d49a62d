"""``bench speed engine``: world-steps per second, counted where they were simulated."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from algorithms.safety_guard import SafetyGuard
from bench.errors import UsageError
from bench.provenance import PROJECT, cpu_model, usable_cores
from envs.driving_env import DrivingVectorEnv, action_space
from envs.layout import sample_initial_worlds
from envs.scenario import LANE_WIDTH_M, Scenario, get_scenario
from envs.world import Ending, Shield

MEASURED_S: Final = 0.4
"""Length of one engine repeat [s]."""
ORACLE_S: Final = 0.3
"""Length of one highway-env repeat [s]."""
PERCEIVED_M: Final = 200.0
"""highway-env's perception distance [m]."""
THREAD_WORLDS: Final = 256
"""Worlds by which two threads are compared with one: at 64 a step lasts 0.2 ms, of which waking one is a tenth."""
DRAWN: Final = 256
"""Decisions for which actions are drawn beforehand."""
FIRST_STEP_REPEATS: Final = 3
GUARD_TC_S: Final = 3.0
"""T_c of the guard whose cost is measured [s]."""

_FIRST_STEP: Final = """
import time
import numpy as np
from envs.driving_env import DrivingVectorEnv
env = DrivingVectorEnv({name!r}, {worlds})
env.reset(seed=0)
env.step(np.zeros(({worlds}, 2)))
print(time.time())
"""


@dataclass(frozen=True, slots=True)
class Rate:
    """Steps per second of wall time, and of processor time, which other load hardly touches."""

    wall: float
    cpu: float


@dataclass(slots=True)
class Meter:
    """An environment, actions drawn beforehand, and the count of world-steps really simulated."""

    env: DrivingVectorEnv
    actions: np.ndarray
    next: int = 0

    @classmethod
    def build(cls, scenario: Scenario, worlds: int, threads: int, shield: Shield | None = None) -> Meter:
        """Warm: compiled, reset and past the first episodes' common start."""
        env = DrivingVectorEnv(scenario, worlds, threads=threads, shield=shield)
        env.reset(seed=0)
        space = action_space(env.action_mode)
        actions = np.random.default_rng(0).uniform(space.low, space.high, (DRAWN, worlds, len(space.low)))
        meter = cls(env, actions)
        meter.repeat(MEASURED_S / 2)
        return meter

    def simulated(self) -> int:
        """World-steps of 0.1 s so far: those of ended episodes and of running ones."""
        running = self.env.world.episode["steps"][self.env.active].sum()
        return int(self.env.finished_episodes()["steps"].sum() + running)

    def repeat(self, seconds: float) -> Rate:
        """World-steps per second over so many seconds of `DrivingVectorEnv.step`."""
        before = self.simulated()
        step, actions, n = self.env.step, self.actions, len(self.actions)
        start, start_cpu = time.perf_counter(), time.process_time()
        while (elapsed := time.perf_counter() - start) < seconds:
            for _ in range(8):
                step(actions[self.next % n])
                self.next += 1
        cpu = time.process_time() - start_cpu
        steps = self.simulated() - before
        return Rate(steps / elapsed, steps / cpu)


class OracleMeter:
    """highway-env's classes on the same scenario, driven by random actions held for one decision.

    Like the engine it gives rewards, costs and endings at every step and an observation at every decision:
    highway-env's own `KinematicObservation` of the ego and the vehicles. `dynamics` leaves the observation out.
    """

    def __init__(self, scenario: Scenario) -> None:
        from highway_env.envs.common.observation import KinematicObservation

        from envs.highway import HighwayOracle

        self._build: Callable[..., Any] = HighwayOracle
        self._observe: Callable[..., Any] = KinematicObservation
        self._scenario = scenario
        self._starts = sample_initial_worlds(scenario, np.random.SeedSequence(0), 256)
        self._rng = np.random.default_rng(0)
        self._row = 0
        self.repeat(ORACLE_S / 3)

    def repeat(self, seconds: float, observed: bool = True) -> Rate:
        """Steps per second over so many seconds, without the time that building a world takes."""
        steps, elapsed, cpu = 0, 0.0, 0.0
        while elapsed < seconds:
            oracle = self._build(self._scenario, self._starts, self._row % 256)
            self._row += 1
            view = SimpleNamespace(road=oracle.road, vehicle=oracle.ego, PERCEPTION_DISTANCE=PERCEIVED_M)
            observation = self._observe(view, vehicles_count=self._scenario.vehicles + 1)
            targets = self._rng.uniform(-LANE_WIDTH_M, LANE_WIDTH_M, 200)
            accelerations = self._rng.uniform(-2.0, 2.0, 200)
            start, start_cpu = time.perf_counter(), time.process_time()
            for i in range(1000):
                decision, first = divmod(i, self._scenario.substeps)
                if observed and first == 0:
                    observation.observe()
                steps += 1
                outcome = oracle.step(float(targets[decision % 200]), float(accelerations[decision % 200]))
                if outcome.ending != Ending.RUNNING or time.perf_counter() - start > seconds:
                    break
            elapsed += time.perf_counter() - start
            cpu += time.process_time() - start_cpu
        return Rate(steps / elapsed, steps / cpu)


@contextmanager
def _one_core() -> Iterator[None]:
    """Keep this process on one core."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def engine(scenario_name: str = "a", worlds: int = 64, repeats: int = 7) -> dict[str, Any]:
    """Medians over repeats; the engine on one core and highway-env take turns, then one thread and two.

    Raises:
        UsageError: The scenario is unknown.
    """
    try:
        scenario = get_scenario(scenario_name)
    except ValueError as error:
        raise UsageError(str(error)) from error
    single = Meter.build(scenario, worlds, threads=1)
    oracle = OracleMeter(scenario)
    rates, oracle_rates, unobserved = [], [], []
    with _one_core():
        for _ in range(repeats):
            rates.append(single.repeat(MEASURED_S))
            oracle_rates.append(oracle.repeat(ORACLE_S))
            unobserved.append(oracle.repeat(ORACLE_S, observed=False))
    rate = statistics.median(rate.wall for rate in rates)
    oracle_rate = statistics.median(rate.wall for rate in oracle_rates)
    return {
        "scenario": scenario.id,
        "worlds": worlds,
        "decision_period_s": scenario.decision_period_s,
        "repeats": repeats,
        "world_steps_per_s": rate,
        "world_steps_per_s_lowest": min(rate.wall for rate in rates),
        "world_steps_per_s_highest": max(rate.wall for rate in rates),
        "world_steps_per_cpu_s": statistics.median(rate.cpu for rate in rates),
        "highway_env_steps_per_s": oracle_rate,
        "highway_env_steps_per_cpu_s": statistics.median(rate.cpu for rate in oracle_rates),
        "highway_env_unobserved_steps_per_s": statistics.median(rate.wall for rate in unobserved),
        "ratio_vs_highway_env": rate / oracle_rate,
        **_guard_cost(scenario, worlds, repeats),
        **_two_threads(scenario, repeats),
        "first_step_s": first_step_s(scenario, worlds),
        "cpu": cpu_model(),
        "usable_cores": usable_cores(),
        "load_average": round(os.getloadavg()[0], 2),
    }


def _guard_cost(scenario: Scenario, worlds: int, repeats: int) -> dict[str, Any]:
    """Interleaved pairs without a guard and behind one, by processor time; the median of what it adds."""
    alone, guarded = (Meter.build(scenario, worlds, 1, shield) for shield in (None, SafetyGuard(GUARD_TC_S)))
    pairs = [(alone.repeat(MEASURED_S).cpu, guarded.repeat(MEASURED_S).cpu) for _ in range(repeats)]
    return {
        "guard_tc_s": GUARD_TC_S,
        "guarded_world_steps_per_cpu_s": statistics.median(behind for _, behind in pairs),
        "guard_overhead": statistics.median(bare / behind for bare, behind in pairs) - 1.0,
    }


def _two_threads(scenario: Scenario, repeats: int) -> dict[str, Any]:
    """Interleaved pairs of one thread and two; the median of their ratios."""
    if usable_cores() < 2:
        return {"two_thread_worlds": THREAD_WORLDS, "two_thread_scaling": None}
    single, double = (Meter.build(scenario, THREAD_WORLDS, threads) for threads in (1, 2))
    pairs = [(single.repeat(MEASURED_S).wall, double.repeat(MEASURED_S).wall) for _ in range(repeats)]
    return {
        "two_thread_worlds": THREAD_WORLDS,
        "world_steps_per_s_one_thread": statistics.median(one for one, _ in pairs),
        "world_steps_per_s_two_threads": statistics.median(two for _, two in pairs),
        "two_thread_scaling": statistics.median(two / one for one, two in pairs),
    }


def first_step_s(scenario: Scenario, worlds: int) -> float:
    """Seconds from the start of a process to its first step with compiled code on disk; median of three."""
    code = _FIRST_STEP.format(name=scenario.name, worlds=worlds)
    times = []
    for _ in range(FIRST_STEP_REPEATS):
        start = time.time()
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=PROJECT, capture_output=True, text=True, check=True, timeout=300
        )
        times.append(float(done.stdout.split()[-1]) - start)
    return statistics.median(times)


def as_text(measured: dict[str, Any]) -> str:
    """The figures for people."""
    scaling = measured["two_thread_scaling"]
    return "\n".join(
        (
            f"{measured['scenario']}, {measured['worlds']} worlds, "
            f"decisions of {measured['decision_period_s']} s, medians of {measured['repeats']} repeats, "
            f"{measured['cpu']}",
            f"engine, one core       {measured['world_steps_per_s']:>12,.0f} world-steps/s",
            f"highway-env, one core  {measured['highway_env_steps_per_s']:>12,.0f} steps/s "
            f"(engine: {measured['ratio_vs_highway_env']:,.0f} times)",
            f"guard, T_c {measured['guard_tc_s']:.0f} s         {measured['guard_overhead']:>12.0%} on top of it",
            f"two threads            {'not measured: one core' if scaling is None else f'{scaling:>12.2f} times one'}"
            f" ({measured['two_thread_worlds']} worlds)",
            f"first step of a process{measured['first_step_s']:>12.2f} s after its start",
        )
    )

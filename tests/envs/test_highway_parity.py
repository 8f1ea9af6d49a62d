"""The engine drives exactly as highway-env's own classes do, step by step, over whole episodes."""

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
import pytest
from highway_env.vehicle.kinematics import Vehicle

from envs import highway, highway_road
from envs.highway import HighwayOracle
from envs.highway_road import CrossedRoad, EgoVehicle, Pedestrian, TrafficVehicle
from envs.layout import EpisodeSource
from envs.scenario import get_scenario
from envs.terms import CostSignal
from envs.trace import EpisodeTrace, record_episode
from envs.world import Ending, World

TOLERANCE_M = 1e-6
TOLERANCE_REWARD = 1e-6
SEED = 20_240_613
PROCESSES = 2

EPISODES = {
    "a": 6,
    "b": 6,
    "a-standing": 1,
    "a-mobil": 2,
    "a-dense-mobil": 1,
    "b-late": 3,
    "a:randomised_traffic=true": 2,
    "a-mobil:randomised_traffic=true": 2,
    "b:lane_changes=true,vehicles=12": 1,
}
"""Whole episodes of each scenario in the fast suite."""

MANY_EPISODES = {
    "a": 200,
    "b": 200,
    "a-standing": 20,
    "a-mobil": 60,
    "a-dense-mobil": 40,
    "b-late": 60,
    "a:randomised_traffic=true": 60,
    "a-mobil:randomised_traffic=true": 60,
    "b:lane_changes=true,vehicles=12": 40,
}
"""The same in the slow suite."""


@dataclass
class Comparison:
    """How far two backends were apart over one episode."""

    number: int
    steps: int
    position_m: float
    reward: float
    disagreements: list[str]
    ending: Ending

    @property
    def agrees(self) -> bool:
        return not self.disagreements and self.position_m <= TOLERANCE_M and self.reward <= TOLERANCE_REWARD


class DisturbedSource(EpisodeSource):
    """Starts that no episode would soon reach: askew, between lanes, amid lane changes, near the edge."""

    def chunk(self, index: int) -> World:
        world = super().chunk(index)
        rng = np.random.default_rng(index)
        ego, cars = world.ego, world.vehicles
        ego["d"] = rng.uniform(-5.2, 5.2, ego.shape)
        ego["heading"] = rng.uniform(-1.2, 1.2, ego.shape)
        ego["reference_d"] = ego["d"] + rng.uniform(-0.5, 0.5, ego.shape)
        cars["s"] *= 0.6
        cars["d"] += rng.uniform(-1.7, 1.7, cars.shape)
        cars["heading"] = rng.uniform(-0.3, 0.3, cars.shape)
        cars["speed"] = rng.uniform(0.0, 14.0, cars.shape)
        cars["headway"] = rng.uniform(0.5, 2.5, cars.shape)
        cars["exponent"] = rng.uniform(2.0, 6.0, cars.shape)
        cars["target_lane"] = rng.integers(0, 3, cars.shape)
        cars["timer"] = rng.uniform(0.01, 1.5, cars.shape)
        return world


def source_of(name: str, kind: type[EpisodeSource] = EpisodeSource) -> EpisodeSource:
    return kind(get_scenario(name), np.random.SeedSequence(SEED))


def drive(source: EpisodeSource, number: int) -> tuple[EpisodeTrace, CostSignal]:
    """An episode of the engine under random actions, each held for five steps.

    Every other driver is in a hurry; cost signals take turns.
    """
    rng = np.random.default_rng([SEED, number])
    signal = CostSignal(number % len(CostSignal))
    low, high = [[-3.5, -2.0 + number % 2]], [[3.5, 2.0]]
    return record_episode(source, number, lambda _: rng.uniform(low, high), cost_signal=signal), signal


def places(records: np.ndarray) -> np.ndarray:
    return np.stack([records["s"], records["d"]], axis=-1)


def largest(difference: np.ndarray) -> float:
    return float(np.abs(difference).max(initial=0.0))


def compare(
    trace: EpisodeTrace, signal: CostSignal, start: World | None = None, steps: int | None = None
) -> Comparison:
    """Replay a trace's commands on the oracle, from its start or another, and compare every step."""
    oracle = HighwayOracle(trace.scenario, start or trace.world(0), 0, signal)
    there, outcomes = [], []
    for target, command in trace.executed[:steps].tolist():
        outcomes.append(oracle.step(target, command))
        there.append(oracle.positions())
    after = slice(1, len(outcomes) + 1)
    present = trace.vehicles["present"][after] == 1
    cars = np.stack([p.vehicles for p in there])
    assert (np.isfinite(cars).all(axis=-1) == present).all()
    gained = {key: np.diff(trace.episode[key])[: len(outcomes)] for key in ("return_driving", "return_comfort", "cost")}
    mine = zip(trace.episode["ending"][after], trace.episode["fault"][after], gained["cost"], strict=True)
    theirs = [(o.ending, o.fault, o.cost) for o in outcomes]
    return Comparison(
        number=trace.number,
        steps=len(outcomes),
        position_m=max(
            largest(places(trace.ego[after]) - np.stack([p.ego for p in there])),
            largest((places(trace.vehicles[after]) - cars)[present]),
            largest(places(trace.pedestrians[after]) - np.stack([p.pedestrians for p in there])),
        ),
        reward=max(
            largest(gained["return_driving"] - [o.driving_reward for o in outcomes]),
            largest(gained["return_comfort"] - [o.comfort_reward for o in outcomes]),
        ),
        disagreements=[f"step {t}: {m}, {n}" for t, (m, n) in enumerate(zip(mine, theirs, strict=True)) if m != n],
        ending=Ending(trace.episode["ending"][len(outcomes)]),
    )


def compare_episodes(name: str, numbers: range, core: int | None = None) -> list[Comparison]:
    """Compare some episodes of a scenario, on one core where the system can pin a process."""
    if core is not None and hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {cores[core % len(cores)]})
    return [compare(*drive(source_of(name), number)) for number in numbers]


@pytest.mark.parametrize("name", EPISODES)
def test_engine_has_parity_with_highway_env(name: str) -> None:
    results = compare_episodes(name, range(EPISODES[name]))
    assert [r for r in results if not r.agrees] == []
    assert all(r.ending is not Ending.RUNNING for r in results)


@pytest.mark.slow
@pytest.mark.parametrize("name", MANY_EPISODES)
def test_engine_has_parity_with_highway_env_over_many_episodes(name: str) -> None:
    with ProcessPoolExecutor(PROCESSES, multiprocessing.get_context("spawn")) as pool:
        shares = [
            pool.submit(compare_episodes, name, range(k, MANY_EPISODES[name], PROCESSES), k) for k in range(PROCESSES)
        ]
        results = [result for share in shares for result in share.result()]
    endings = {e.name.lower(): sum(r.ending is e for r in results) for e in Ending}
    position, reward = (max(getattr(r, key) for r in results) for key in ("position_m", "reward"))
    print(
        f"\n{name}: {len(results)} episodes, {sum(r.steps for r in results)} steps, "
        f"positions within {position:.1e} m, rewards within {reward:.1e}, {endings}"
    )
    assert [r for r in results if not r.agrees] == []
    assert len(results) == MANY_EPISODES[name]


@pytest.mark.parametrize("name", ["a-dense-mobil:randomised_traffic=true", "b:lane_changes=true"])
def test_parity_holds_from_disturbed_starts(name: str) -> None:
    source = source_of(name, DisturbedSource)
    results = [compare(*drive(source, number), steps=50) for number in range(12)]
    assert [r for r in results if not r.agrees] == []
    assert {Ending.COLLISION, Ending.OFF_ROAD} <= {r.ending for r in results}


def test_parity_of_lateral_targets_with_the_plain_formula() -> None:
    offsets: list[float] = []
    rng = np.random.default_rng(SEED)

    def act(_: np.ndarray) -> np.ndarray:
        offsets.append(rng.uniform(-3.5, 3.5))
        return np.array([[offsets[-1], 0.5]])

    trace = record_episode(source_of("a"), 0, act)
    substeps = trace.scenario.substeps
    for k, offset in enumerate(offsets):
        d = trace.ego["d"][k * substeps]
        lane = float(np.argmin(np.abs(d - np.array([-3.5, 0.0, 3.5]))))
        expected = min(max(3.5 * (lane - 1.0) + offset, -4.25), 4.25)
        held = trace.proposed[k * substeps : (k + 1) * substeps, 0]
        np.testing.assert_allclose(held, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("field", ["headway", "exponent", "desired_speed"])
def test_parity_breaks_when_a_parameter_of_the_traffic_is_one_percent_off(field: str) -> None:
    trace, signal = drive(source_of("a"), 0)
    wrong = trace.world(0).copy()
    wrong.vehicles[field] *= 1.01
    assert compare(trace, signal, steps=150).agrees
    assert compare(trace, signal, wrong, steps=150).position_m > TOLERANCE_M


def judged_by_the_follower(
    self: TrafficVehicle, ego_vehicle: Vehicle, front_vehicle: Vehicle = None, rear_vehicle: Vehicle = None
) -> float:
    judge = ego_vehicle if isinstance(ego_vehicle, TrafficVehicle) else self
    return super(TrafficVehicle, judge).acceleration(ego_vehicle, front_vehicle, rear_vehicle)


def act_backwards(self: CrossedRoad) -> None:
    for vehicle in reversed(self.vehicles):
        vehicle.act()


def step_pedestrians_first(self: CrossedRoad, dt: float) -> None:
    self.step_pedestrians(dt)
    for vehicle in self.vehicles:
        vehicle.step(dt)


TRAFFIC = ("a", EpisodeSource, 100)
WHOLE = ("a", EpisodeSource, None)
MOBIL = ("a-dense-mobil:randomised_traffic=true", DisturbedSource, 50)
PEDESTRIANS = ("b", EpisodeSource, None)

# What is driven, the first episode that is tried (the earliest that tells the variants apart), what is replaced.
WRONG_VARIANTS = {
    "jam distance": (TRAFFIC, 0, TrafficVehicle, "DISTANCE_WANTED", 10.1),
    "comfortable braking": (TRAFFIC, 0, TrafficVehicle, "COMFORT_ACC_MIN", -5.05),
    "ego's highest speed": (WHOLE, 3, highway_road, "EGO_SPEED_MAX_MPS", 13.88),
    "goal": (WHOLE, 5, highway, "GOAL_M", 750.0),
    "time limit": (WHOLE, 0, highway, "TIME_LIMIT_S", 89.9),
    "road edge": (MOBIL, 3, highway, "ROAD_EDGE_M", 5.5),
    "heading gain": (MOBIL, 0, TrafficVehicle, "KP_HEADING", 5.05),
    "lateral gain": (MOBIL, 0, TrafficVehicle, "KP_LATERAL", 1.01 / 0.6),
    "gain of a lane change": (MOBIL, 0, TrafficVehicle, "LANE_CHANGE_MIN_ACC_GAIN", 0.25),
    "imposed braking": (MOBIL, 32, TrafficVehicle, "LANE_CHANGE_MAX_BRAKING_IMPOSED", 1.8),
    "delay": (MOBIL, 0, TrafficVehicle, "LANE_CHANGE_DELAY", 1.1),
    "politeness": (MOBIL, 8, TrafficVehicle, "POLITENESS", 0.1),
    "ego's desired speed": (MOBIL, 28, EgoVehicle, "target_speed", 0.0),
    "order of decisions": (MOBIL, 4, CrossedRoad, "act", act_backwards),
    "who judges": (MOBIL, 17, TrafficVehicle, "acceleration", judged_by_the_follower),
    "kerb": (PEDESTRIANS, 2, highway_road, "KERB_M", 5.65),
    "size of pedestrians": (PEDESTRIANS, 4, Pedestrian, "LENGTH", 0.7),
    "pedestrians before vehicles": (PEDESTRIANS, 1, CrossedRoad, "step", step_pedestrians_first),
}


@pytest.mark.parametrize("variant", WRONG_VARIANTS)
def test_parity_breaks_on_a_wrong_variant(variant: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (name, kind, steps), first, owner, attribute, wrong = WRONG_VARIANTS[variant]
    monkeypatch.setattr(owner, attribute, wrong)
    source = source_of(name, kind)
    numbers = range(first, first + 20)
    assert any(not compare(*drive(source, number), steps=steps).agrees for number in numbers)

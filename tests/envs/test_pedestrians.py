"""Pedestrians wait, step off where the rule allows it, cross once, and never surprise an ego that brakes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from algorithms.scripted_policies import DRIVERS
from envs import engine
from envs.driving_env import DrivingVectorEnv
from envs.engine import STEPS_MAX
from envs.geometry import PEDESTRIAN_SIZE_M, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M
from envs.layout import EpisodeSource, sample_initial_worlds
from envs.motion import HORIZON_S
from envs.pedestrians import (
    KERB_M,
    SPEED_MAX_MPS,
    SPEED_MIN_MPS,
    TRIGGER_GAP_MAX_M,
    TRIGGER_GAP_MIN_M,
    car_can_yield,
    ego_can_stop,
    step,
    traffic_can_yield,
)
from envs.scenario import PedestrianRule, get_scenario
from envs.world import CROSSING, GONE, WAITING, Ending, Fault, World
from tests.envs.small_worlds import advance, one_world

kernels = pytest.mark.kernels


@kernels
def test_constants_are_those_of_the_reference() -> None:
    assert (KERB_M, PEDESTRIAN_SIZE_M) == (5.75, 0.6)
    assert (SPEED_MIN_MPS, SPEED_MAX_MPS, TRIGGER_GAP_MIN_M, TRIGGER_GAP_MAX_M) == (0.8, 1.8, 30.0, 90.0)


@kernels
def test_the_fair_gap_is_3_6_seconds_and_a_metre() -> None:
    assert not ego_can_stop(37.0, 10.0)
    assert ego_can_stop(37.0001, 10.0)
    assert not ego_can_stop(1.0, 0.0)


@kernels
@given(st.floats(0.0, 13.89))
def test_the_fair_gap_exceeds_the_way_to_a_stop_in_steps(speed: float) -> None:
    # Explicit Euler covers v^2 / (2 x 2) + v dt / 2 and a rounding of the last step.
    assert not ego_can_stop(speed**2 / 4.0 + 0.05 * speed, speed)


@kernels
@pytest.mark.parametrize(
    ("ds", "speed", "desired", "walk", "free"),
    [
        # 2 s of walking. Passing: 0.8 x 10 x 2 = 16 m forward; gone with its rear bumper 1 m beyond needs another
        # 2.5 + 0.3 + 1 = 3.8 m: ds at or below 12.2 m.
        (12.2 - 1e-9, 10.0, 10.0, 2.0, True),
        (12.2 + 1e-6, 10.0, 10.0, 2.0, False),
        (-3.8 - 1e-9, 0.0, 10.0, 2.0, True),
        (-3.7, 0.0, 0.0, 2.0, False),
        # Approaching at its desired 10 m/s: 20 m forward, then 10^2 / 10 + 0.5 x 10 = 15 m of braking and 2.8 m of
        # bodies: 37.8 m.
        (37.8 + 1e-9, 10.0, 10.0, 2.0, True),
        (37.8 - 1e-6, 10.0, 10.0, 2.0, False),
        # It may speed up by 3 x 2 = 6 m/s: from 4 to 10 m/s at most, the same 37.8 m, though it is slow now.
        (37.8 + 1e-9, 4.0, 12.0, 2.0, True),
        (37.8 - 1e-6, 4.0, 12.0, 2.0, False),
        # Faster than it wants: its own speed counts.
        (37.8 + 1e-9, 10.0, 8.0, 2.0, True),
        (37.8 - 1e-6, 10.0, 8.0, 2.0, False),
        # A standing car that wants nothing else: 1 m and the bodies.
        (3.8 + 1e-9, 0.0, 0.0, 5.0, True),
        (3.8 - 1e-6, 0.0, 0.0, 5.0, False),
    ],
)
def test_a_car_has_passed_or_can_brake_by_hand(
    ds: float, speed: float, desired: float, walk: float, free: bool
) -> None:
    assert car_can_yield(ds, speed, desired, walk) is free


@kernels
@given(st.floats(0.0, 150.0), st.floats(0.0, 13.89), st.floats(0.0, 13.89), st.floats(0.0, 8.0), st.floats(0.0, 50.0))
def test_a_car_that_can_brake_could_also_do_so_from_farther_away(
    ds: float, speed: float, desired: float, walk: float, more: float
) -> None:
    if ds > 0.8 * speed * walk and car_can_yield(ds, speed, desired, walk):
        assert car_can_yield(ds + more, speed, desired, walk)


def person(state: int = WAITING, side: float = 1.0, **fields: float) -> dict[str, float]:
    """At the kerb at 100 m, walking at 1.5 m/s across the road."""
    start = {"s": 100.0, "d": side * KERB_M, "lateral_speed": -side * 1.5, "trigger_gap": 60.0}
    return {"state": state, **start, **fields}


def allows(vehicles: list[dict[str, float]], *others: dict[str, float], side: float = 1.0) -> bool:
    world = one_world({}, vehicles, [person(side=side), *others])
    return bool(traffic_can_yield(world.vehicles, world.pedestrians, 0, 0))


@kernels
def test_nobody_steps_off_while_another_one_crosses() -> None:
    assert allows([], person(WAITING, s=300.0), person(GONE))
    assert not allows([], person(CROSSING, s=300.0))


@kernels
@pytest.mark.parametrize(
    ("d", "side", "way_m"),
    [
        # From the kerb at 5.75 m to 2.75 m before a lane's centre.
        (3.5, 1.0, 0.0),
        (0.0, 1.0, 3.0),
        (-3.5, 1.0, 6.5),
        (3.5, -1.0, 6.5),
        (0.0, -1.0, 3.0),
        (-3.5, -1.0, 0.0),
        (1.0, 1.0, 3.0),  # not in the middle of its lane: the lane counts
    ],
)
def test_a_car_is_judged_at_the_time_when_the_pedestrian_reaches_its_lane(d: float, side: float, way_m: float) -> None:
    for s in np.arange(-20.0, 130.0, 3.0):
        expected = car_can_yield(100.0 - s, 9.0, 9.0, way_m / 1.5)
        assert allows([{"s": float(s), "d": d, "speed": 9.0}], side=side) == expected


@kernels
def test_one_car_that_cannot_yield_is_enough_and_absent_ones_do_not_count() -> None:
    free, blocked = {"s": 200.0, "d": 0.0}, {"s": 100.0, "d": 3.5}
    assert allows([free])
    assert not allows([free, blocked])
    assert allows([free, {**blocked, "present": 0}])


def steps_off(ego: dict[str, float], fair: bool = True, **fields: float) -> bool:
    world = one_world(ego, [], [person(**fields)])
    step(world.ego, world.vehicles, world.pedestrians, 0, fair)
    assert world.pedestrians.d[0, 0] == KERB_M  # the first pace follows a step later
    return bool(world.pedestrians.state[0, 0] == CROSSING)


@kernels
@pytest.mark.parametrize(
    ("gap", "fair", "late"),
    [
        (60.0001, False, False),  # farther away than the trigger gap
        (59.9999, True, True),
        (37.001, True, True),
        (36.999, False, True),  # 3.6 x 10 + 1 m: too near to stop
        (0.001, False, True),
        (-0.001, False, False),  # alongside
        (-30.0, False, False),  # passed, though 24 m away
    ],
)
def test_a_pedestrian_steps_off_between_the_trigger_gap_and_the_fair_gap(gap: float, fair: bool, late: bool) -> None:
    ego = {"s": 100.0 - gap - 2.8, "speed": 10.0}
    assert steps_off(ego, fair=True) is fair
    assert steps_off(ego, fair=False) is late


@kernels
def test_a_pedestrian_crosses_once_at_a_constant_speed() -> None:
    world = one_world({"s": 50.0}, [], [person(CROSSING, side=1.0), person(CROSSING, side=-1.0)])
    w = (world.ego, world.vehicles, world.pedestrians)
    step(*w, 0, True)
    assert world.pedestrians.d[0].tolist() == pytest.approx([KERB_M - 0.15, -KERB_M + 0.15])
    # 11.5 m from kerb to kerb at 0.15 m a step: the 77th step goes beyond it.
    for _ in range(75):
        step(*w, 0, True)
    assert world.pedestrians.state[0].tolist() == [CROSSING, CROSSING]
    step(*w, 0, True)
    assert world.pedestrians.state[0].tolist() == [GONE, GONE]
    at = world.pedestrians.d[0].copy()
    for _ in range(5):
        step(*w, 0, True)
    assert (world.pedestrians.d[0] == at).all()
    assert world.pedestrians.state[0].tolist() == [GONE, GONE]


@kernels
@pytest.mark.parametrize("lane_d", [-3.5, 0.0, 3.5])
def test_an_approaching_car_stops_for_whoever_steps_off_at_the_last_moment(lane_d: float) -> None:
    # The nearest approaching position that the rule allows; the car wants 12 m/s and brakes by IDM alone.
    way = max(abs(lane_d - KERB_M) - 2.75, 0.0) / 1.5
    distances = (x for x in np.arange(9.6 * way, 150.0, 0.01) if car_can_yield(float(x), 12.0, 12.0, way))
    ds = float(next(distances))
    world = one_world({"s": -500.0}, [{"s": 100.0 - ds, "d": lane_d, "speed": 12.0}], [person(CROSSING)])
    while world.pedestrians.state[0, 0] == CROSSING:
        advance(world)
        assert not overlaps(world).any()


def overlaps(world: World) -> np.ndarray:
    """Crossing pedestrians that overlap a present car of heading 0, shape (N, P, V)."""
    people, cars = world.pedestrians[:, :, None], world.vehicles[:, None, :]
    near = np.abs(people["s"] - cars["s"]) <= 0.5 * (VEHICLE_LENGTH_M + PEDESTRIAN_SIZE_M)
    beside = np.abs(people["d"] - cars["d"]) <= 0.5 * (VEHICLE_WIDTH_M + PEDESTRIAN_SIZE_M)
    found: np.ndarray = near & beside & (people["state"] == CROSSING) & (cars["present"] == 1)
    return found


def step_off_and_brake(name: str, spawns: int, seed: int) -> tuple[int, int]:
    """Pedestrians who stepped off, and those of them hit by an ego at full braking from that moment on.

    The ego drives at random, mostly gaining speed, and brakes at -2 m/s2 while anybody crosses. No cars: they would
    only hold pedestrians back.
    """
    scenario = get_scenario(name)
    n = -(-spawns // scenario.pedestrians)
    world = sample_initial_worlds(scenario, np.random.SeedSequence(seed), n)
    world.vehicles["present"] = 0
    rng = np.random.default_rng(seed)
    target, horizon, zeros = world.ego["d"].copy(), np.full(n, HORIZON_S), np.zeros(n)
    fair = scenario.pedestrian_rule is PedestrianRule.FAIR
    for k in range(STEPS_MAX):
        if k % 10 == 0:
            driving = rng.uniform(-1.0, 2.0, n)
        command = np.where((world.pedestrians["state"] == CROSSING).any(axis=1), -2.0, driving)
        engine.advance(
            world.ego, world.vehicles, world.pedestrians, world.episode, target, command, horizon, zeros,
            target, command, zeros > 0.0, 1, False, False, fair, 0, np.zeros((n, 4)),
        )  # fmt: skip
    assert (world.episode["ending"] != Ending.RUNNING).all()
    stepped = int((world.pedestrians["state"] != WAITING).sum())
    return stepped, int((world.episode["fault"] == Fault.PEDESTRIAN).sum())


@pytest.mark.parametrize(
    "spawns", [5_000, pytest.param(100_000, marks=pytest.mark.slow)], ids=lambda spawns: f"{spawns}-spawns"
)
def test_full_braking_at_step_off_never_hits(spawns: int) -> None:
    stepped, hit = step_off_and_brake("b", spawns, seed=spawns)
    print(f"\n{stepped} of {spawns} pedestrians stepped off, {hit} were hit")
    assert stepped > 0.6 * spawns
    assert hit == 0


def test_without_the_fair_rule_some_crashes_are_unavoidable() -> None:
    _, hit = step_off_and_brake("b-late", 3_000, seed=1)
    assert hit > 30


def driven_through(driver: str, episodes: int) -> tuple[int, int]:
    """Finished episodes of b, and those in which a car overlapped a crossing pedestrian at the end of any step."""
    scenario = get_scenario("b")
    worlds = min(episodes, 256)
    source = EpisodeSource(scenario, np.random.SeedSequence(7), 0, episodes)
    env = DrivingVectorEnv(scenario, worlds, source=source)
    policy = DRIVERS[driver]()
    policy.begin(worlds, np.random.SeedSequence(3))
    found: set[int] = set()

    def look(world: World, *_: np.ndarray) -> None:
        rows = np.flatnonzero((world.pedestrians["state"] == CROSSING).any(axis=1))
        few = World(*(a[rows] for a in (world.ego, world.vehicles, world.pedestrians, world.episode)))
        found.update(few.episode["episode"][overlaps(few).any(axis=(1, 2))].tolist())

    env.on_substep = look
    observations, _ = env.reset()
    while env.active.any():
        observations = env.step(policy.act(observations))[0]
    return env.episodes_done, len(found)


@pytest.mark.parametrize("driver", ["idm", "cruise"])
@pytest.mark.parametrize(
    "episodes", [400, pytest.param(20_000, marks=pytest.mark.slow)], ids=lambda episodes: f"{episodes}-episodes"
)
def test_traffic_does_not_drive_through_crossing_pedestrians(driver: str, episodes: int) -> None:
    done, bad = driven_through(driver, episodes)
    print(f"\n{driver}: a car overlapped a crossing pedestrian in {bad} of {done} episodes")
    assert done == episodes
    assert bad <= episodes / 1000

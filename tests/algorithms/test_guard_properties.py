"""What the guard promises for every T_c in [0.5, 7] s, whatever is proposed: by Hypothesis, and by an adversary."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from algorithms.guard_options import GuardOptions
from envs.driving_env import DrivingVectorEnv
from envs.world import Fault
from tests.algorithms.guard_games import (
    EngineGame,
    GuardOfMany,
    against_adversary,
    against_careless,
    facing,
)

LANES_D = (-3.5, 0.0, 3.5)
WORLDS, STEPS = 40, 150
MANY_WORLDS, MANY_STEPS = 1000, 250


def draw_scene(kind, worlds, seed):
    """Adjustment times and a game: S_safe = 3.6 v holds to what is ahead; half of the gaps are just that."""
    rng = np.random.default_rng(seed)
    tc, speed = rng.uniform(0.5, 7.0, worlds), rng.uniform(0.0, 13.89, worlds)
    d = rng.uniform(-4.25, 4.25, worlds)
    gap = 3.6 * speed + np.where(rng.random(worlds) < 0.5, 0.0, rng.exponential(10.0, worlds))
    if kind == "pedestrian":
        return tc, facing(d, speed, gap, rng.uniform(-5.25, 5.25, worlds), None)
    if kind == "beside":
        # In the next lane, up to 40 m ahead or behind; it keeps its lane and its speed.
        d = rng.choice(LANES_D, worlds)
        other = np.where(d == 0.0, rng.choice([-3.5, 3.5], worlds), 0.0)
        return tc, facing(d, speed, rng.uniform(-45.0, 35.0, worlds), other, rng.uniform(0.0, 13.89, worlds))
    braking = np.where(rng.random(worlds) < 0.5, 0.0, -2.0)
    return tc, facing(d, speed, gap, rng.choice(LANES_D, worlds), rng.uniform(0.0, 13.89, worlds), braking)


# --- Behind a leader, before a pedestrian ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["leader", "pedestrian", "beside"])
@pytest.mark.parametrize("sideways", [False, True])
def test_an_adversary_cannot_make_the_ego_touch_what_is_ahead_or_alongside(kind, sideways):
    tc, game = draw_scene(kind, WORLDS, 1)
    assert against_adversary(game, tc, STEPS, sideways).touched_ahead == 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["leader", "pedestrian", "beside"])
@pytest.mark.parametrize("sideways", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_an_adversary_fails_in_a_thousand_worlds(kind, sideways, seed):
    tc, game = draw_scene(kind, MANY_WORLDS, 10 + seed)
    assert against_adversary(game, tc, MANY_STEPS, sideways).touched_ahead == 0


@pytest.mark.parametrize("kind", ["leader", "pedestrian"])
@pytest.mark.parametrize("throttle", [False, True])
def test_careless_drivers_touch_nobody(kind, throttle):
    tc, game = draw_scene(kind, 1000, 2)
    rng = np.random.default_rng(3)

    def draw():
        return rng.uniform(-4.25, 4.25, 1000), np.full(1000, 2.0) if throttle else rng.uniform(-2.0, 2.0, 1000)

    assert (against_careless(game, tc, 200, draw).world.episode["fault"] == Fault.NONE).all()


def test_without_the_braking_reserve_the_adversary_reaches_the_pedestrian():
    tc, game = draw_scene("pedestrian", 150, 5)
    assert against_adversary(game, tc, STEPS, options=GuardOptions(reserve=False)).touched_ahead > 0


@pytest.mark.parametrize(
    ("tc", "reserve", "touched"), [(5.0, False, 1), (7.0, False, 1), (3.0, False, 0), (7.0, True, 0)]
)
def test_at_a_long_adjustment_time_the_printed_rule_does_not_stop_in_time(tc, reserve, touched):
    # 13.89 m/s, S_safe = 50 m before a man who stands in the lane, full throttle: contact at 0.8 (5 s), 2.0 m/s (7 s).
    game = facing(*(np.array([value]) for value in (0.0, 13.89, 3.6 * 13.89, 0.0)), None)
    guard = GuardOfMany(np.array([tc]), GuardOptions(reserve=reserve))
    for _ in range(200):
        game.step(guard, np.zeros(1), np.full(1, 2.0))
    assert game.touched_ahead == touched


actions = st.lists(st.tuples(st.floats(-4.25, 4.25), st.floats(-2.0, 2.0), st.integers(1, 15)), min_size=1, max_size=12)


def play(game, tc, chosen):
    """Drive one world by held actions, the last one until 25 s are over."""
    guard = GuardOfMany(np.array([tc]))
    held = [(target, acceleration) for target, acceleration, steps in chosen for _ in range(steps)]
    for target, acceleration in held + [held[-1]] * (250 - len(held)):
        game.step(guard, np.array([target]), np.array([acceleration]))
    return game


@settings(deadline=None, max_examples=40)
@given(
    st.floats(0.5, 7.0), st.floats(-4.25, 4.25), st.floats(0.0, 13.89), st.floats(0.01, 60.0),
    st.sampled_from(LANES_D), st.floats(0.0, 13.89), st.sampled_from([0.0, -2.0]), actions,
)  # fmt: skip
def test_the_ego_never_touches_a_leader_from_where_the_safe_gap_holds(
    tc, d, speed, more, lane, leader, braking, chosen
):
    one = [np.array([value]) for value in (d, speed, 3.6 * speed + more, lane, leader, braking)]
    assert play(facing(*one), tc, chosen).touched_ahead == 0


@settings(deadline=None, max_examples=40)
@given(
    st.floats(0.5, 7.0), st.floats(-4.25, 4.25), st.floats(0.0, 13.89), st.floats(0.01, 60.0), st.floats(-5.25, 5.25),
    actions,
)  # fmt: skip
def test_the_ego_never_touches_a_standing_pedestrian_seen_at_the_safe_gap(tc, d, speed, more, person, chosen):
    one = [np.array([value]) for value in (d, speed, 3.6 * speed + more, person)]
    assert (play(facing(*one, None), tc, chosen).world.episode["fault"] == Fault.NONE).all()


# --- Lane changes ---------------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=40)
@given(
    st.floats(0.5, 7.0), st.sampled_from(LANES_D), st.floats(0.0, 13.89), st.floats(-10.0, 30.0), st.booleans(),
    st.floats(0.0, 13.89), actions,
)  # fmt: skip
def test_a_lane_change_never_ends_in_contact_with_a_car_alongside_or_ahead(tc, d, speed, gap, left, other, chosen):
    lane = (3.5 if left else -3.5) if d == 0.0 else 0.0
    one = [np.array([value]) for value in (d, speed, gap, lane, other)]
    assert play(facing(*one), tc, chosen).touched_ahead == 0


def engine_game(scenario, worlds, seed):
    env = DrivingVectorEnv(scenario, worlds)
    env.reset(seed=seed)
    return np.random.default_rng(seed).uniform(0.5, 7.0, worlds), EngineGame(env.world.copy(), np.zeros(worlds))


@pytest.mark.parametrize(("scenario", "sideways"), [("a", True), ("b", False)])
def test_an_adversary_causes_no_contact_of_any_kind_in_traffic(scenario, sideways):
    tc, game = engine_game(scenario, 25, 0)
    final = against_adversary(game, tc, STEPS, sideways).world.episode
    assert (final["fault"] == Fault.NONE).all()
    assert final["steps"].max() == STEPS


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["a", "b"])
@pytest.mark.parametrize("sideways", [False, True])
@pytest.mark.parametrize("seed", [1, 2])
def test_an_adversary_causes_no_contact_in_three_hundred_episodes(scenario, sideways, seed):
    tc, game = engine_game(scenario, 300, seed)
    assert (against_adversary(game, tc, 400, sideways).world.episode["fault"] == Fault.NONE).all()

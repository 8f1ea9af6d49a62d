"""What goes in and comes out: observations within bounds, arrays that nobody overwrites, bad input refused."""

import itertools
import re
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from algorithms.scripted_policies import DRIVERS
from envs.driving_env import ActionMode, DrivingVectorEnv, MutatedObservationError
from envs.observation import observation_space
from envs.scenario import scenario_names
from envs.single_env import DrivingEnv
from tests.envs.roll_outs import Recorded, source
from tests.envs.small_worlds import driving_env

kernels = pytest.mark.kernels
DRIVERS_TO_CHECK = ("random", "full-throttle", "constant-speed")


@pytest.mark.parametrize("name", [*scenario_names()[:8], "a:randomised_traffic=true", "b:decision_period_s=0.1"])
def test_observations_stay_within_their_bounds(name: str) -> None:
    low, high = observation_space().low, observation_space().high
    for driver in DRIVERS_TO_CHECK:
        env = DrivingVectorEnv(name, 32, source=source(name, 64))
        policy = DRIVERS[driver]()
        policy.begin(32, np.random.SeedSequence(1))
        observations, _ = env.reset()
        while env.active.any():
            observations, reward, _, _, info = env.step(policy.act(observations))
            for x in (observations, info.get("final_obs", observations)):
                assert x.dtype == np.float32
                assert (x >= low).all()
                assert (x <= high).all()
            assert np.isfinite(reward).all()


@kernels
@settings(max_examples=20)
@given(st.lists(st.tuples(st.floats(0.5, 4.0), st.floats(-3.5, 3.5), st.floats(0.0, 13.89)), min_size=1, max_size=40))
def test_any_plan_of_the_driving_agent_keeps_to_the_bounds(plan: list[tuple[float, float, float]]) -> None:
    env = driving_env("a-standing", action_mode=ActionMode.PLANNING)
    env.reset(seed=0)
    for action in plan:
        observations, reward, *_ = env.step(np.array([action]))
        assert observations in env.observation_space
        assert np.isfinite(reward).all()


@kernels
def test_returned_arrays_are_not_overwritten_by_later_steps() -> None:
    env = driving_env("a", 2)
    first, _ = env.reset(seed=0)
    kept = first.copy()
    second, reward, _, _, info = env.step(np.ones((2, 2)))
    held = [second.copy(), reward.copy(), info["cost"].copy(), info["intervened"].copy()]
    for _ in range(10):
        env.step(np.ones((2, 2)))
    assert (first == kept).all()
    assert all((a == b).all() for a, b in zip([second, reward, info["cost"], info["intervened"]], held, strict=True))


@kernels
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("world", "entry"), [(0, 0), (0, 1), (2, 1)])
def test_an_action_that_is_not_finite_is_refused_and_changes_nothing(world: int, entry: int, bad: float) -> None:
    env = driving_env("a", 3)
    env.reset(seed=0)
    before = env.world.copy()
    wrong = np.zeros((3, 2))
    wrong[world, entry] = bad
    with pytest.raises(ValueError, match=f"Action entry {entry} of world {world} is {bad}: must be finite"):
        env.step(wrong)
    assert env.world.ego.tobytes() == before.ego.tobytes()
    assert env.decisions == 0


@kernels
@pytest.mark.parametrize("shape", [(2,), (3, 3), (2, 2), (3, 2, 1), (3, 1)])
def test_actions_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    env = driving_env("a", 3)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=re.escape(f"Actions have shape {shape}; expected (3, 2)")):
        env.step(np.zeros(shape))


@kernels
@pytest.mark.parametrize(
    ("what", "value"),
    [
        *itertools.product(("acceleration", "target", "horizon"), (np.nan, np.inf)),
        ("horizon", 0.0),
        ("horizon", -1.0),
    ],
)
def test_a_shields_answer_that_cannot_be_used_is_refused(what: str, value: float) -> None:
    env = driving_env("a", 2, shield=Recorded(**{what: value}))
    env.reset(seed=0)
    before = env.world.copy()
    with pytest.raises(ValueError, match=rf"Shield Recorded gave world 0 the {what} {value}: must be finite"):
        env.step(np.zeros((2, 2)))
    assert env.world.ego.tobytes() == before.ego.tobytes()


@kernels
@pytest.mark.parametrize("part", range(4))
@pytest.mark.parametrize("wrong", [np.zeros(1), np.zeros((2, 1)), np.array(1.0), 1.0, [1.0, 1.0]])
def test_a_shields_answer_of_another_shape_is_refused(part: int, wrong: object) -> None:
    class Misshapen(Recorded):
        def filter(self, *arguments: Any) -> Any:
            answer = [*super().filter(*arguments)]
            answer[part] = wrong.astype(bool) if part == 2 and isinstance(wrong, np.ndarray) else wrong
            return tuple(answer)

    env = driving_env("a", 2, shield=Misshapen())
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"Shield Misshapen gave .*: must be arrays of shape \(2,\), one value"):
        env.step(np.zeros((2, 2)))


@kernels
def test_a_shields_flags_are_truth_values() -> None:
    env = driving_env("a", 2, shield=Recorded(flag=0.5))  # type: ignore[arg-type]
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"Shield Recorded gave .* flags float64 \(2,\).*the flags of bool"):
        env.step(np.zeros((2, 2)))


@kernels
def test_values_beyond_the_action_space_are_clipped_to_it() -> None:
    beyond, at = (driving_env("a") for _ in range(2))
    for env, action in ((beyond, [99.0, -99.0]), (at, [3.5, -2.0])):
        env.reset(seed=0)
        env.step(np.array([action]))
    assert beyond.world.ego.tobytes() == at.world.ego.tobytes()


@pytest.mark.parametrize(("num_envs", "threads"), [(0, 1), (-1, 1), (1, 0)])
def test_worlds_and_threads_are_counted_from_one(num_envs: int, threads: int) -> None:
    with pytest.raises(ValueError, match=f"num_envs = {num_envs}, threads = {threads}: both must be at least 1"):
        DrivingVectorEnv("a", num_envs, threads=threads)


def test_unknown_names_and_values_are_refused_at_construction() -> None:
    with pytest.raises(ValueError, match="Unknown scenario 'c'"):
        DrivingEnv("c")
    with pytest.raises(ValueError, match="vehicles = -4"):
        DrivingEnv("a:vehicles=-4")
    with pytest.raises(ValueError, match="render_mode = 'human'"):
        DrivingEnv("a", render_mode="human")
    with pytest.raises(gymnasium.error.NameNotFound, match="DenseTraffic"):
        gymnasium.make("bench/DenseTrafic-v1")
    with pytest.raises(gymnasium.error.VersionNotFound, match=r"bench/DenseTraffic.*`v1`"):
        gymnasium.make("bench/DenseTraffic-v9")


def test_a_spawn_that_cannot_fit_is_refused_at_construction() -> None:
    with pytest.raises(ValueError, match="vehicles = 100: must be 1 to 27, what fits into 180 m of 3 lanes"):
        DrivingEnv("a:vehicles=100")
    DrivingEnv("a:vehicles=27").reset(seed=0)


def test_a_watched_environment_refuses_to_go_on_once_its_observations_were_written_into():
    for watched in (True, False):
        env = DrivingVectorEnv("a", 3, watched=watched)
        observations, _ = env.reset(seed=0)
        observations = env.step(np.zeros((3, 2)))[0]
        observations[1, 5] += 0.25
        if watched:
            with pytest.raises(MutatedObservationError, match="copy them first"):
                env.step(np.zeros((3, 2)))
        else:
            env.step(np.zeros((3, 2)))


def test_a_watched_environment_goes_on_from_a_snapshot():
    first, second = (DrivingVectorEnv("a", 3, watched=True) for _ in range(2))
    first.reset(seed=0)
    second.reset(seed=0)
    first.step(np.ones((3, 2)))
    second.restore(first.snapshot())
    assert np.array_equal(second.step(np.ones((3, 2)))[0], first.step(np.ones((3, 2)))[0])

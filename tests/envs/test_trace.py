"""A recorded episode is what the environment drove, at every step of 0.1 s."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from envs import scenario as scenarios
from envs.driving_env import ActionMode, DrivingVectorEnv
from envs.layout import EpisodeSource, held_out_source
from envs.scenario import get_scenario
from envs.trace import EpisodeTrace, load_trace, record_episode
from envs.world import BoolArray, Ending, FloatArray, World

SCENARIO = get_scenario("b")
FULL_THROTTLE = np.array([[1.0, 2.0]])


class Brake:
    """A shield that halves the acceleration and flags every step in which the ego is faster than 10 m/s."""

    def begin(self, seed: np.random.SeedSequence) -> None:
        pass

    def observe(self, observations: np.ndarray) -> None:
        self.observations = observations

    def filter(
        self, world: World, targets: FloatArray, accelerations: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray | None]:
        fast = world.ego["speed"] > 10.0
        return targets, np.where(fast, 0.5 * accelerations, accelerations), fast, None


def source() -> EpisodeSource:
    return EpisodeSource(SCENARIO, np.random.SeedSequence(7))


@pytest.fixture(scope="module")
def trace() -> EpisodeTrace:
    return record_episode(source(), 5, lambda _: FULL_THROTTLE, shield=Brake())


def test_a_trace_starts_at_the_numbered_episode_and_ends_with_it(trace: EpisodeTrace) -> None:
    start = source().chunk(0)
    assert trace.ego[0] == start.ego[5]
    assert (trace.vehicles[0] == start.vehicles[5]).all()
    assert (trace.pedestrians[0] == start.pedestrians[5]).all()
    assert (trace.episode["ending"][:-1] == Ending.RUNNING).all()
    assert trace.episode["ending"][-1] != Ending.RUNNING
    assert (trace.episode["steps"] == np.arange(len(trace) + 1)).all()
    assert (trace.episode["episode"] == trace.number).all()


@pytest.mark.parametrize("shield", [None, Brake()])
def test_recording_does_not_change_the_episode(shield: Brake | None) -> None:
    trace = record_episode(source(), 5, lambda _: FULL_THROTTLE, shield=shield)
    only = dataclasses.replace(source(), start=5, stop=6)
    env = DrivingVectorEnv(SCENARIO, 1, source=only, autoreset=False, shield=shield)
    env.reset()
    while env.active[0]:
        env.step(FULL_THROTTLE)
    assert trace.episode[-1] == env.world.episode[0]
    assert trace.ego[-1] == env.world.ego[0]


def test_actions_are_recorded_as_proposed_and_as_executed(trace: EpisodeTrace) -> None:
    fast = trace.ego["speed"][:-1] > 10.0
    assert fast.any()
    assert not fast.all()
    assert (trace.intervened == fast).all()
    assert (trace.proposed[:, 1] == 2.0).all()
    assert (trace.executed[:, 1] == np.where(fast, 1.0, 2.0)).all()
    assert (trace.executed[:, 0] == trace.proposed[:, 0]).all()


def test_the_driving_agents_actions_are_recorded() -> None:
    act = np.array([[2.0, 0.0, 12.0]])
    trace = record_episode(source(), 0, lambda _: act, action_mode=ActionMode.PLANNING)
    assert np.isnan(trace.proposed[:, 1]).all()
    assert (np.abs(trace.executed[:, 1]) <= 2.0).all()
    assert trace.executed[:, 1].any()


def test_a_policy_sees_what_the_environment_shows() -> None:
    seen = []

    def act(observations: np.ndarray) -> np.ndarray:
        seen.append(observations)
        return FULL_THROTTLE

    trace = record_episode(source(), 0, act)
    speeds = np.concatenate(seen)[:, 2] * 13.89
    np.testing.assert_allclose(speeds, trace.ego["speed"][: len(trace) : SCENARIO.substeps], rtol=1e-6)


def test_a_world_of_a_trace_is_the_row_of_its_step(trace: EpisodeTrace) -> None:
    assert len(trace.world(3)) == 1
    assert trace.world(3).ego[0] == trace.ego[3]
    assert trace.world(-1).ego[0] == trace.ego[len(trace)]
    with pytest.raises(IndexError):
        trace.world(len(trace) + 1)


def test_a_trace_survives_saving(trace: EpisodeTrace, tmp_path: Path) -> None:
    trace.save(tmp_path / "trace.npz")
    loaded = load_trace(tmp_path / "trace.npz")
    for field in dataclasses.fields(EpisodeTrace):
        assert np.all(getattr(loaded, field.name) == getattr(trace, field.name)), field.name


def test_a_trace_of_another_version_is_refused(
    trace: EpisodeTrace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trace.save(tmp_path / "trace.npz")
    monkeypatch.setitem(scenarios._BUILT_IN, "b", dataclasses.replace(SCENARIO, version=99))
    with pytest.raises(ValueError, match=r"trace\.npz is of b-v1; this is b-v99"):
        load_trace(tmp_path / "trace.npz")


def test_arrays_of_different_lengths_are_refused(trace: EpisodeTrace) -> None:
    with pytest.raises(ValueError, match="ego: "):
        dataclasses.replace(trace, ego=trace.ego[1:])


@pytest.mark.parametrize("number", [-1, 10])
def test_an_episode_outside_the_source_is_refused(number: int) -> None:
    with pytest.raises(ValueError, match=f"Episode {number}: the source has 0 to 10"):
        record_episode(held_out_source(SCENARIO, 10), number, lambda _: FULL_THROTTLE)

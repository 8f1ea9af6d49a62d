"""Checkpoints are whole or not used, the last two are kept, and reading one executes nothing."""

import os
import pickle
import time

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from algorithms.checkpoints import FileCheckpoints, Interval, NoCheckpoints, State
from algorithms.resuming import environment, generators, restore_environment, restore_generators
from algorithms.safety_guard import SafetyGuard
from envs.driving_env import DrivingVectorEnv
from envs.layout import EpisodeSource
from envs.scenario import get_scenario
from envs.world import EPISODE


def state(step: int) -> State:
    """A state whose growing part has one row a step."""
    episodes = np.zeros(step, EPISODE)
    episodes["steps"] = np.arange(step)
    weights = np.full((3, 2), step, np.float32)
    return State(
        {"weights": weights}, {"rows": np.arange(2 * step).reshape(step, 2), "episodes": episodes}, {"n": step},
        at="at rest",
    )  # fmt: skip


class Curve:
    """A host with one number."""

    def __init__(self, value):
        self.value = value
        self.resumed = None

    def snapshot(self):
        return {"value": self.value}

    def restore(self, values, steps, at):
        self.value, self.resumed = values["value"], (steps, at)


def assert_is(found, step):
    expected = state(step)
    assert found is not None
    assert dict(found.values) == dict(expected.values)
    for kind in ("arrays", "growing"):
        ours, theirs = getattr(found, kind), getattr(expected, kind)
        assert ours.keys() == theirs.keys()
        for name, values in theirs.items():
            np.testing.assert_array_equal(ours[name], values)
            assert ours[name].dtype == values.dtype


def saved(folder, *steps, identity="same"):
    checkpoints = FileCheckpoints(folder, identity)
    for step in steps:
        checkpoints.save(step, state(step))
    return checkpoints


def test_the_newest_state_comes_back_with_its_host(tmp_path):
    FileCheckpoints(tmp_path, "same", Curve(1.5)).save(4, state(4))
    curve = Curve(0.0)
    assert_is(FileCheckpoints(tmp_path, "same", curve).load(), 4)
    assert (curve.value, curve.resumed) == (1.5, (4, "at rest"))


def test_the_last_two_states_are_kept_and_every_row_is_written_once(tmp_path):
    saved(tmp_path, 3, 3, 5, 9)
    assert [path.name for path in sorted(tmp_path.glob("*[0-9].npz"))] == ["000003.npz", "000004.npz"]
    rows = [len(np.load(path)["rows"]) for path in sorted(tmp_path.glob("*.rows.npz"))]
    assert rows == [3, 0, 2, 4]
    assert_is(FileCheckpoints(tmp_path, "same").load(), 9)


@pytest.mark.parametrize("damage", ["truncate", "flip", "empty", "remove rows"])
def test_a_torn_checkpoint_gives_the_one_before(tmp_path, damage, capsys):
    saved(tmp_path, 3, 5, 9)
    path = tmp_path / "000003.npz"
    content = path.read_bytes()
    if damage == "truncate":
        path.write_bytes(content[: len(content) // 2])
    elif damage == "flip":
        at = content.index(np.full((3, 2), 9, np.float32).tobytes())
        path.write_bytes(content[:at] + b"\x01" + content[at + 1 :])
    elif damage == "empty":
        path.write_bytes(b"")
    else:
        (tmp_path / "000003.rows.npz").unlink()
    again = FileCheckpoints(tmp_path, "same")
    assert_is(again.load(), 5)
    assert "checkpoint 3 is not used" in capsys.readouterr().err
    again.save(8, state(8))
    assert_is(FileCheckpoints(tmp_path, "same").load(), 8)


@settings(max_examples=15)
@given(st.lists(st.integers(0, 6), min_size=1, max_size=6), st.integers(0, 5))
def test_whatever_was_torn_and_gone_on_from_the_rows_are_those_of_the_steps(tmp_path_factory, gains, torn):
    folder = tmp_path_factory.mktemp("checkpoints")
    steps = np.cumsum(gains).tolist()
    saved(folder, *steps)
    for path in sorted(folder.glob("*[0-9].npz"))[-1:] if torn % 2 else []:
        path.write_bytes(b"torn")
    again = FileCheckpoints(folder, "same")
    found = again.load()
    at = 0 if found is None else found.values["n"]
    again.save(at + torn, state(at + torn))
    assert_is(FileCheckpoints(folder, "same").load(), at + torn)


def test_all_torn_means_from_the_beginning_and_nothing_is_left_of_them(tmp_path):
    saved(tmp_path / "run", 3, 5)
    for path in (tmp_path / "run").iterdir():
        path.write_bytes(b"torn")
    assert FileCheckpoints(tmp_path / "run", "same").load() is None
    assert not (tmp_path / "run").exists()


def test_a_state_of_other_code_is_not_gone_on_from(tmp_path, capsys):
    saved(tmp_path, 3, identity="before the correction")
    assert FileCheckpoints(tmp_path, "after it").load() is None
    assert "other code" in capsys.readouterr().err


def test_a_hostile_pickle_under_our_name_is_refused_unread(tmp_path):
    class Hostile:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "executed"),)

    folder = tmp_path / "run"
    saved(folder, 3, 5)
    (folder / "000002.npz").write_bytes(pickle.dumps(Hostile()))
    np.savez(folder / "000001.npz", weights=np.array([Hostile()], object))
    assert FileCheckpoints(folder, "same").load() is None
    assert not (tmp_path / "executed").exists()


def test_a_full_disk_at_every_call_leaves_the_checkpoints_that_are_there(tmp_path, monkeypatch, capsys):
    calls = {"count": 0, "fails_at": 0}

    def failing(real):
        def call(*arguments):
            calls["count"] += 1
            if calls["count"] == calls["fails_at"]:
                raise OSError(28, "No space left on device")
            return real(*arguments)

        return call

    for name in ("fsync", "replace"):
        monkeypatch.setattr(os, name, failing(getattr(os, name)))
    saved(tmp_path / "0", 3)
    needed = calls["count"]
    for n in range(1, needed + 1):
        folder = tmp_path / str(n)
        checkpoints = saved(folder, 3)
        calls.update(count=0, fails_at=n)
        checkpoints.save(5, state(5))
        calls.update(fails_at=0)
        assert "No space left" in capsys.readouterr().err
        assert not [path for path in folder.iterdir() if path.name.startswith(".")]
        # The very last call is a sync after the file was renamed.
        assert_is(FileCheckpoints(folder, "same").load(), 5 if n == needed else 3)
        checkpoints.save(8, state(8))
        assert_is(FileCheckpoints(folder, "same").load(), 8)


def test_a_checkpoint_is_due_by_steps_or_by_a_clock_that_nobody_sets(tmp_path, monkeypatch):
    now = {"monotonic": 1000.0, "time": 5e9}
    monkeypatch.setattr(time, "monotonic", lambda: now["monotonic"])
    monkeypatch.setattr(time, "time", lambda: now["time"])
    by_steps, by_time = FileCheckpoints(tmp_path, "", None, Interval(1e9, 500)), FileCheckpoints(tmp_path, "")
    assert not by_steps.due(499)
    assert by_steps.due(500)
    by_steps.save(600, State())
    assert not by_steps.due(1099)
    now["time"] -= 1e6  # set back, then forward
    assert not by_time.due(10**9)
    now["time"] += 1e9
    assert not by_time.due(10**9)
    now["monotonic"] += 60.0
    assert by_time.due(0)
    by_time.save(0, State())
    assert not by_time.due(10**9)


def test_no_checkpoints_keep_nothing():
    nothing = NoCheckpoints()
    nothing.save(3, state(3))
    assert not nothing.due(10**9)
    assert nothing.load() is None


def test_parts_of_a_joined_state_come_apart_again():
    joined = State.joined("", a=state(2), ab=state(3))
    assert_is(joined.part("a"), 2)
    assert_is(joined.part("ab"), 3)


def test_the_global_generators_go_on_where_they_were():
    def draws():
        return torch.rand(2).tolist(), np.random.rand(2).tolist(), np.random.randn(), random_draw()

    def random_draw():
        import random

        return random.random(), random.gauss(0, 1)

    draws()
    kept = generators()
    first = draws()
    restore_generators(kept)
    assert draws() == first


class Wavering(SafetyGuard):
    """Draws its T_c at every decision: a shield that remembers something."""

    def __init__(self):
        super().__init__()
        self.rng = np.random.default_rng(5)

    def observe(self, observations):
        self.drawn = self.rng.uniform(0.5, 7.0, len(observations))

    def horizons(self, world):
        return self.drawn

    def snapshot(self):
        return {"generator": dict(self.rng.bit_generator.state)}

    def restore(self, values):
        self.rng.bit_generator.state = values["generator"]


@pytest.mark.parametrize("name", ["a", "b-late", "a-dense-mobil"])
def test_an_environment_goes_on_where_it_was_with_what_its_shield_remembers(name):
    def make():
        source = EpisodeSource(get_scenario(name), np.random.SeedSequence(4))
        return DrivingVectorEnv(name, 8, source=source, shield=Wavering())

    def drive(env, rng, steps):
        return [env.step(rng.uniform([-3.5, -2.0], [3.5, 2.0], (8, 2)))[:4] for _ in range(steps)]

    env, rng = make(), np.random.default_rng(0)
    env.reset()
    drive(env, rng, 200)
    kept, draws = environment(env), rng.bit_generator.state
    expected = drive(env, rng, 150)
    other = make()
    restore_environment(other, kept)
    rng.bit_generator.state = draws
    for ours, theirs in zip(drive(other, rng, 150), expected, strict=True):
        for one, two in zip(ours, theirs, strict=True):
            np.testing.assert_array_equal(one, two)
    assert len(env.finished_episodes()) >= 8
    np.testing.assert_array_equal(other.finished_episodes(), env.finished_episodes())
    assert other.steps_done == env.steps_done


def test_an_environment_of_another_size_is_refused():
    env = DrivingVectorEnv("a", 2)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"ego has shape \(2,\); this environment needs \(3,\)"):
        DrivingVectorEnv("a", 3).restore(env.snapshot())

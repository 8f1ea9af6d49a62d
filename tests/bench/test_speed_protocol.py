"""Shares of a run's time: exclusive, complete, and taken where the work is done."""

import time
from types import SimpleNamespace

import pytest

from bench.protocols import Request
from bench.speed.protocol import ENGINE, GUARD, OTHER, POLICY, SHARED, Stopwatch, protocol


@pytest.fixture
def clock(monkeypatch):
    """Processor time that only `clock.spend` moves."""
    now = SimpleNamespace(seconds=0.0)
    monkeypatch.setattr(time, "process_time", lambda: now.seconds)

    def spend(seconds):
        now.seconds += seconds

    return spend


def test_a_part_does_not_count_what_the_parts_inside_it_spend(clock):
    class Engine:
        def step(self):
            clock(2.0)
            guard.filter()
            clock(1.0)

    class Guard:
        def filter(self):
            clock(4.0)

    engine, guard = Engine(), Guard()
    watch = Stopwatch(_since=0.0)
    with watch.timed(Engine, "step", ENGINE), watch.timed(Guard, "filter", GUARD):
        clock(1.0)
        engine.step()
        clock(2.0)
    assert watch.shares() == {ENGINE: 0.3, GUARD: 0.4, OTHER: 0.3}


def test_what_all_seeds_share_is_no_part_of_a_run_whatever_is_called_inside_it(clock):
    class Engine:
        def step(self):
            clock(2.0)

    class Model:
        def train(self):
            clock(10.0)
            engine.step()

    engine = Engine()
    watch = Stopwatch(_since=0.0)
    with watch.timed(Engine, "step", ENGINE), watch.timed(Model, "train", SHARED):
        Model().train()
        engine.step()
        clock(6.0)
    assert watch.shares() == {ENGINE: 0.25, OTHER: 0.75}
    assert watch.seconds[SHARED] == 12.0


def test_what_was_timed_is_given_back_also_after_an_error(clock):
    class Engine:
        def step(self):
            raise ValueError("broken")

    original = Engine.step
    watch = Stopwatch(_since=0.0)
    with pytest.raises(ValueError, match="broken"), watch.timed(Engine, "step", ENGINE):
        Engine().step()
    assert Engine.step is original
    clock(5.0)
    assert watch.shares()[OTHER] == 1.0


def test_a_guarded_driver_spends_its_time_in_engine_and_guard():
    found = protocol(Request("cruise+guard", "a", "smoke", "1", eval_episodes=64))["cruise+guard"]
    assert sum(found["share"].values()) == pytest.approx(1.0)
    assert min(found["share"][ENGINE], found["share"][GUARD]) > 0.0
    assert POLICY not in found["share"], "a scripted driver has no network"
    assert found["steps_per_s"] is None
    assert found["shared_s"] == 0.0
    assert found["eval_episodes"] == 64

"""The estimate of `bench run --dry-run`: rates of records, setup once, workers in turn."""

from types import SimpleNamespace

import pytest

from algorithms.identity import source_digest
from bench.estimate import (
    DEFAULT_EVAL_RATE,
    DEFAULT_ON_POLICY_RATE,
    DEFAULT_TRAIN_RATE,
    RISK_MODEL_S,
    START_S,
    estimate,
)
from bench.provenance import CODE, cpu_model
from tests.optional import needs_omnisafe


def spec(method="sac", scenario="a", steps=1_000, episodes=100, **settings):
    return SimpleNamespace(method=method, scenario=scenario, steps=steps, eval_episodes=episodes, settings=settings)


def record(of, train_s, evaluate_s, timeline=(), cpu=None, sources=None):
    timing = {"train": {"cpu_s": train_s, "wall_s": 2 * train_s}, "evaluate": {"cpu_s": evaluate_s}}
    made_by = {"cpu": cpu or cpu_model(), "source_sha256": sources or source_digest(CODE)}
    details = {"timing": timing, "timeline": list(timeline), "provenance": made_by}
    return SimpleNamespace(spec=of, details=details)


def test_a_run_takes_what_its_like_took_by_processor_time():
    found = estimate([spec(steps=3_000, episodes=50)], [record(spec(), 10.0, 4.0)], workers=1)
    assert found.seconds == pytest.approx((3 * 10.0 + 4.0 / 2,))
    assert found.wall_s == pytest.approx(START_S + 32.0)


def test_without_records_stated_defaults_decide():
    found = estimate([spec()], [], workers=1)
    assert found.seconds == pytest.approx((1_000 / DEFAULT_TRAIN_RATE + 100 / DEFAULT_EVAL_RATE,))
    assert "assumed" in found.basis


@needs_omnisafe
@pytest.mark.parametrize("method", ["cpo", "focops", "trpo-lag", "omnisafe:algo=PPO"])
def test_without_records_methods_of_omnisafe_have_a_default_of_their_own(method):
    found = estimate([spec(method, steps=100_000, episodes=1_000)], [], workers=1)
    assert found.seconds == pytest.approx((100_000 / DEFAULT_ON_POLICY_RATE + 1_000 / DEFAULT_EVAL_RATE,))
    assert "9,000 by OmniSafe" in found.basis


def test_records_of_another_scenario_serve_until_there_are_some_of_this_one():
    records = [record(spec(), 10.0, 1.0), record(spec(scenario="b"), 30.0, 1.0)]
    assert estimate([spec(scenario="b")], records, 1).seconds == pytest.approx((31.0,))
    assert estimate([spec(scenario="a-dense")], records, 1).seconds == pytest.approx((1_000 * 3 / 200 + 1.0,))


def test_records_of_the_same_settings_come_first_then_those_of_the_same_scenario():
    records = [
        record(spec(decisions_per_update="16"), 10.0, 0.0),
        record(spec("sac", "b", decisions_per_update="16"), 20.0, 0.0),
        record(spec(), 40.0, 0.0),
        record(spec("sac", "b"), 90.0, 0.0),
    ]
    wanted = [spec(episodes=0, decisions_per_update="16")]
    # Same settings and scenario, same settings, same scenario, what is left.
    for left, seconds in enumerate((10.0, 20.0, 40.0, 90.0)):
        found = estimate(wanted, records[left:], 1)
        assert found.seconds == pytest.approx((seconds,))
        assert ("with other settings" in found.basis) == (left >= 2)


def test_the_same_settings_by_older_sources_tell_more_than_other_settings():
    records = [record(spec(learner="sb3"), 40.0, 0.0, sources="before"), record(spec(), 10.0, 0.0)]
    assert estimate([spec(episodes=0, learner="sb3")], records, 1).seconds == pytest.approx((40.0,))


def test_of_other_settings_those_that_share_most_and_then_those_that_add_least_come_first():
    records = [
        record(spec(), 40.0, 0.0),
        record(spec(decisions_per_update="1", batch="64"), 160.0, 0.0),
        record(spec(batch="256"), 90.0, 0.0),
    ]
    assert estimate([spec(episodes=0, decisions_per_update="1")], records, 1).seconds == pytest.approx((160.0,))
    assert estimate([spec(episodes=0, learner="fast")], records, 1).seconds == pytest.approx((40.0,))


def test_records_of_the_same_parameters_come_before_those_of_the_same_scenario():
    records = [
        record(spec("omnisafe:algo=PPO", "b"), 10.0, 0.0),
        record(spec("omnisafe:algo=CUP"), 40.0, 0.0),
    ]
    assert estimate([spec("omnisafe:algo=PPO", episodes=0)], records, 1).seconds == pytest.approx((10.0,))
    assert estimate([spec("omnisafe:algo=PPO", episodes=0)], records[1:], 1).seconds == pytest.approx((40.0,))


def test_records_of_this_processor_come_first():
    records = [record(spec(), 10.0, 1.0), record(spec(), 90.0, 9.0, cpu="another one")]
    found = estimate([spec()], records, 1)
    assert found.seconds == pytest.approx((11.0,))
    assert found.basis == "1 of 1 runs at rates measured in this results folder"
    found = estimate([spec()], records[1:], 1)
    assert found.seconds == pytest.approx((99.0,))
    assert "on another kind of processor" in found.basis


def test_records_of_these_sources_come_first_and_others_serve_until_there_are_some():
    old = record(spec(), 30.0, 3.0, sources="before")
    found = estimate([spec()], [old, record(spec(), 10.0, 1.0)], 1)
    assert found.seconds == pytest.approx((11.0,))
    assert "another version" not in found.basis
    found = estimate([spec(), spec("cpo")], [old, record(spec("cpo"), 10.0, 1.0)], 1)
    assert found.seconds == pytest.approx((33.0, 11.0))
    assert "by another version of the code" in found.basis


def test_setup_is_counted_once_for_a_scenario_and_budget_without_a_record():
    # Reports at 100 and 200 steps, 62 and 64 s: 60 of 80 s of wall time went by before; so did 30 of 40 s.
    seen = record(spec("dd-rq"), 40.0, 0.5, timeline=[(100, 62.0), (200, 64.0)])
    again, new = spec("dd-rq"), spec("dd-rq", steps=2_000)
    assert estimate([again], [seen], 1).seconds == pytest.approx((10.0 + 0.5,))
    assert estimate([new, new], [seen], 1).seconds == pytest.approx((20.0 + 0.5 + 30.0, 20.0 + 0.5))


def test_setup_is_what_any_settings_and_parameters_took_for_it():
    # The first made what both share: 30 of 40 s; the second found it made.
    first = record(spec("dd-rq"), 40.0, 0.0, timeline=[(100, 62.0), (200, 64.0)])
    second = record(spec("dd-rq:tc=mean", learner="sb3"), 20.0, 0.0, timeline=[(100, 2.0), (200, 4.0)])
    new = spec("dd-rq:tc=mean", steps=2_000, episodes=0, learner="sb3")
    assert estimate([new], [first, second], 1).seconds == pytest.approx((40.0 + 30.0,))


def test_without_records_the_driving_agent_and_the_risk_model_are_counted_once():
    first, second, other = estimate([spec("dd-rq"), spec("dd-rq:tc=mean"), spec("safety-guard:tc=1.0")], [], 1).seconds
    assert second == other
    assert first - second == pytest.approx(RISK_MODEL_S + 1_000 / DEFAULT_TRAIN_RATE)


def test_workers_take_runs_in_turn():
    records = [record(spec(), 10.0, 0.0), record(spec("cpo"), 4.0, 0.0)]
    runs = [spec(episodes=0), spec("cpo", episodes=0), spec("cpo", episodes=0), spec("cpo", episodes=0)]
    assert estimate(runs, records, 2).wall_s == pytest.approx(START_S + 12.0)
    assert estimate([], records, 2).wall_s == 0.0

"""Settings of the learner against the budget, and what the learner is made with."""

import pytest

from algorithms import sac_training
from algorithms.method import Budget, Task
from algorithms.registry import get_method
from algorithms.sac import GAMMA_PER_STEP, LEARNERS, SACSettings
from algorithms.sac_training import train_sac
from envs.scenario import get_scenario


def task_of(steps, scenario="a", **settings):
    return Task(get_scenario(scenario), 0, Budget(steps), settings={key: str(value) for key, value in settings.items()})


def test_every_learner_that_settings_accept_can_be_made_and_no_other():
    assert tuple(sac_training.LEARNER_CLASSES) == LEARNERS


def test_an_update_after_more_decisions_than_worlds_needs_a_budget_of_whole_roll_outs():
    # 200 decisions: 2 worlds x 100; an update every 12 decisions would take 204.
    wrong = task_of(1_000, worlds=2, decisions_per_update=12)
    with pytest.raises(ValueError, match=r"decisions_per_update = 12.* multiple of 60; nearest: 1020.* = 2"):
        train_sac(wrong)
    assert wrong.steps_done() == 0
    right = task_of(1_020, worlds=2, decisions_per_update=12)
    train_sac(right)
    assert right.steps_done() == 1_020


@pytest.mark.parametrize("every", [1, 2, 4, 8, 16, 32, 64])
def test_where_no_roll_out_is_longer_than_one_decision_any_budget_of_the_worlds_will_do(every):
    # 100,000 steps are 312.5 x 64 decisions: `make_env` speaks of the worlds, not this.
    chosen = SACSettings.for_task(task_of(100_000, worlds=64, decisions_per_update=every))
    assert chosen == SACSettings(worlds=64, decisions_per_update=every)


@pytest.mark.parametrize("method", ["dd-rq", "dd-rq-plus"])
def test_it_is_refused_before_driving_agent_and_risk_model_are_trained(method, monkeypatch):
    monkeypatch.setattr("algorithms.risk_training.risk_model", lambda *_, **__: pytest.fail("trained"))
    with pytest.raises(ValueError, match="decisions_per_update = 32"):
        get_method(method).train(task_of(4_000 + 80, decisions_per_update=32))


class Stopped(Exception):
    """Ends a training before it has begun."""


@pytest.mark.parametrize(("scenario", "steps"), [("a", 5), ("a:decision_period_s=0.1", 1)])
def test_the_discount_of_a_decision_is_that_of_its_steps(scenario, steps, monkeypatch):
    made = {}

    def learner(*_, **arguments):
        made.update(arguments)
        raise Stopped

    monkeypatch.setitem(sac_training.LEARNER_CLASSES, "fast", learner)
    with pytest.raises(Stopped):
        train_sac(task_of(4_000, scenario))
    assert GAMMA_PER_STEP == 0.99
    assert made["gamma"] == 0.99**steps

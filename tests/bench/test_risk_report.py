"""The risk report: its scenes and outcomes, its figures on cases worked by hand, the same bytes twice."""

import json
import math

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from algorithms.method import Policy
from algorithms.risk_model import RiskArchitecture, RiskModel, RiskNetwork
from bench.cli.commands import app
from bench.risk import episodes, figures, measures, report
from bench.risk.rollouts import Rollouts, inverse_time_to_collision, risk_of, roll_out
from envs.driving_env import ActionMode
from envs.scenario import get_scenario
from envs.world import Ending, empty_world


class Hasty(Policy):
    """Keeps to the nearest lane at full speed, T_c longer where the ego is faster: it runs into its leader."""

    action_mode = ActionMode.PLANNING

    def act(self, observations):
        n = len(observations)
        return np.column_stack([0.5 + 3.0 * observations[:, 2], np.zeros(n), np.full(n, 13.89)])

    def save(self, folder):
        raise NotImplementedError


@pytest.fixture(scope="module")
def models():
    torch.manual_seed(0)
    size = RiskArchitecture(width=8, heads=2, layers=1, hidden=8)
    described = {"scenario": "a-v1", "agent": "driving-agent-0", "r2_held_out": 0.5}
    return {method: RiskModel(RiskNetwork(size), size, described) for method in ("dd-rq", "dd-rq-plus")}


def scenes(risk, contact, episodes=None):
    """Scenes of dd-rq-plus with a given RQ [%]."""
    probability = np.clip(np.asarray(risk) / 100.0, 1e-12, 1.0 - 1e-12)
    return Rollouts(
        np.arange(len(risk)) if episodes is None else episodes,
        np.linspace(0.5, 4.0, len(risk)),
        {"dd-rq-plus": np.log(probability / (1.0 - probability))},
        np.asarray(risk) / 10.0,
        np.asarray(contact, bool),
    )


def test_risk_is_the_turned_planning_time_or_the_probability():
    assert risk_of("dd-rq", np.array([0.5, 2.25, 4.0])).tolist() == pytest.approx([100.0, 50.0, 0.0])
    assert risk_of("dd-rq-plus", np.array([0.0, math.log(3.0)])).tolist() == pytest.approx([50.0, 75.0])


def test_time_to_collision_counts_what_closes_in_on_the_path():
    world = empty_world(3, 1, 0)
    world.ego["speed"] = 10.0
    world.vehicles["present"] = 1
    world.vehicles["s"][:, 0], world.vehicles["speed"][:, 0] = 25.0, (5.0, 12.0, 5.0)
    world.vehicles["d"][2, 0] = 3.5
    # Bumper gap 20 m, closing at 5 m/s: 4 s; drawing off, or in another lane: never.
    assert inverse_time_to_collision(world).tolist() == pytest.approx([0.25, 0.0, 0.0])


def test_a_score_that_ranks_as_the_outcomes_has_full_area_and_its_calibration_error_is_by_hand():
    # Two scenes at 20 % without, two at 80 % with contact: 0.2 off in every bin.
    found = measures.judge(scenes([20.0, 20.0, 80.0, 80.0], [0, 0, 1, 1]), "dd-rq-plus")
    assert found["auc_contact"]["value"] == 1.0
    assert found["spearman_contact"]["value"] == pytest.approx(1.0)
    assert found["spearman_inverse_ttc"]["value"] == pytest.approx(1.0)
    assert found["expected_calibration_error"] == pytest.approx(0.2)
    assert [(row["scenes"], row["contacts"]) for row in found["bins"]] == [(2, 0), (2, 2)]
    assert found["is_probability"]


def test_a_turned_score_is_told_apart():
    found = measures.judge(scenes([80.0, 80.0, 20.0, 20.0], [0, 0, 1, 1]), "dd-rq-plus")
    assert found["auc_contact"]["value"] == 0.0
    assert found["expected_calibration_error"] == pytest.approx(0.8)


def test_scenes_within_three_seconds_of_a_crash_are_marked(models):
    rollouts = roll_out(Hasty(), models, get_scenario("a"), worlds=16, decisions=60)
    assert len(rollouts.contact) == 16 * 60
    assert 0.0 < rollouts.contact.mean() < 1.0
    # Whoever crashes has at most 3 s / 0.5 s marked decisions, and an episode's marks are its last scenes.
    for number in np.unique(rollouts.episodes[rollouts.contact]):
        marks = rollouts.contact[rollouts.episodes == number]
        assert 1 <= marks.sum() <= 6
        assert marks[-marks.sum() :].all()
    # The one that keeps its lane at full speed closes in before it crashes.
    assert rollouts.inverse_ttc[rollouts.contact].mean() > 2.0 * rollouts.inverse_ttc[~rollouts.contact].mean()


def test_moments_are_those_of_lowest_and_highest_risk_and_the_end():
    assert figures.moments(np.array([5.0, 1.0, 9.0, 4.0])) == [1, 2, 3]
    assert figures.moments(np.array([1.0, 5.0])) == [0, 1]


def test_importance_is_placed_on_present_bodies_and_sums_to_one(models):
    episode = episodes.first_ending(Hasty(), models, get_scenario("b"), Ending.COLLISION)
    importance = episode.importance["dd-rq"]
    assert importance.shape == (len(episode.trace) + 1, 5 + 3)
    assert np.allclose(importance.sum(1), 1.0)
    assert episode.risk["dd-rq"].shape == (len(episode.trace) + 1,)


def test_the_report_is_whole_and_the_same_bytes_twice(models, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "load", lambda *_: (Hasty(), models))
    monkeypatch.setattr(report, "SHOWN", {"contact": Ending.COLLISION})
    monkeypatch.setattr(figures, "DPI", 40)
    real = report.roll_out
    monkeypatch.setattr(report, "roll_out", lambda *given: real(*given, worlds=16, decisions=40))
    for name in ("first", "second"):
        found = report.command("a", 1000, tmp_path, tmp_path / name)
    files = sorted(path.name for path in (tmp_path / "first").iterdir())
    kinds = ("contact-dd-rq", "contact-dd-rq-plus", "planning-times", "reliability")
    assert files == sorted(["report.json", "report.md", *(f"{k}.{end}" for k in kinds for end in ("png", "pdf"))])
    for name in files:
        assert (tmp_path / "first" / name).read_bytes() == (tmp_path / "second" / name).read_bytes(), name
    kept = json.loads((tmp_path / "first" / "report.json").read_text())
    assert kept["models"]["dd-rq"]["is_probability"] is False
    assert kept["models"]["dd-rq-plus"]["is_probability"] is True
    assert kept["scenes"] == found["scenes"] == 16 * 40
    assert "no probability" in (tmp_path / "first" / "report.md").read_text()


def test_an_unknown_scenario_is_named(tmp_path):
    done = CliRunner().invoke(app, ["risk", "report", "--scenario", "aa", "--results", str(tmp_path)])
    assert done.exit_code == 2
    assert "aa" in done.output

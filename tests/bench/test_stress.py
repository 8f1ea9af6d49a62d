"""Stress of a guard: its figures, episodes that come back the same, bad input, records and their tables."""

import dataclasses
import json
from pathlib import Path

import pytest
import torch
from typer.testing import CliRunner

from algorithms.guard_options import GuardOptions
from algorithms.risk_guard import RiskGuard
from algorithms.risk_model import RiskArchitecture, RiskModel, RiskNetwork
from bench import figures_guard
from bench.cli.commands import app
from bench.errors import UsageError
from bench.replay.stressed import parse_name, replay_named
from bench.stress import parse_options, replay_stress, stress_guard
from envs.world import Ending

PROMISED = {"episodes", "collisions", "ego_at_fault", "pedestrian", "intervention_ratio", "mean_speed_mps", "worst"}
BARE = GuardOptions(reserve=False, hold=False, give_way=False, turned_body=False, excursion=False)


def invoke(*arguments):
    return CliRunner().invoke(app, ["stress", *arguments])


def untrained(_scenario):
    torch.manual_seed(0)
    size = RiskArchitecture()
    return RiskGuard(RiskModel(RiskNetwork(size), size, {}))


def test_the_command_prints_the_promised_keys():
    done = invoke("guard", "--scenario", "a", "--tc", "3.0", "--episodes", "20", "--driver", "cruise", "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.output)
    assert set(found) >= PROMISED
    assert found["episodes"] == 20
    assert len(found["worst"]) == 5


def test_a_collision_comes_back_in_its_replay():
    found = stress_guard("b", 7.0, 300, "full-throttle-lane-change", BARE)
    assert found.collisions > 0
    assert found.options["reserve"] is False
    trace = replay_stress("b", 7.0, "full-throttle-lane-change", found.worst[0], BARE)
    assert trace.number == found.worst[0]
    assert trace.episode["ending"][-1] == Ending.COLLISION
    off = ":".join(f"{field.name}=false" for field in dataclasses.fields(GuardOptions) if field.default)
    named = parse_name(f"stress:b:tc=7.0:driver=full-throttle-lane-change:{off}")
    again = replay_named(named, found.worst[:1], Path())[0].trace
    assert again.ego.tobytes() == trace.ego.tobytes()


def test_no_figure_depends_on_how_many_worlds_are_driven_at_a_time_with_a_risk_model_either():
    first, second = (stress_guard("b", "dd-rq", 40, worlds=n, shield_factory=untrained) for n in (40, 7))
    assert first == second
    assert first.intervention_ratio > 0.0
    assert first.options == dataclasses.asdict(GuardOptions())


@pytest.mark.parametrize("tc", ["0", "-1", "nan", "inf", "soon"])
def test_an_unusable_adjustment_time_ends_with_a_message(tc):
    done = invoke("guard", "--episodes", "1", "--tc", tc)
    assert done.exit_code == 2
    assert tc in done.output


def test_unknown_drivers_options_and_sets_are_named():
    for arguments, named in (
        (("guard", "--episodes", "1", "--driver", "drunk"), "drunk"),
        (("guard", "--episodes", "1", "--set", "reserved=false"), "reserve"),
        (("guard", "--episodes", "1", "--set", "reserve=no"), "reserve=no"),
        (("record", "--only", "everything"), "everything"),
    ):
        done = invoke(*arguments)
        assert done.exit_code == 2
        assert named in done.output


def test_options_are_read_by_name():
    assert parse_options([]) == GuardOptions()
    assert parse_options(["reserve=false", "literal_followers=true"]) == GuardOptions(
        reserve=False, literal_followers=True
    )


def case(**changes):
    return figures_guard.StressCase("a", 3.0, episodes=8, **changes)


def test_what_is_on_record_is_not_run_again_and_more_episodes_are_as_good(tmp_path, monkeypatch):
    path, cases = tmp_path / "some.json", (case(), case(options=GuardOptions(hold=False)))
    assert len(list(figures_guard.record_cases(path, cases, tmp_path))) == 2
    monkeypatch.setattr(figures_guard, "run_case", lambda *_: pytest.fail("ran again"))
    fewer = [dataclasses.replace(one, episodes=5) for one in cases]
    assert list(figures_guard.record_cases(path, fewer, tmp_path)) == []
    assert [record["episodes"] for record in figures_guard.read_records(path)] == [8, 8]
    stale = [json.dumps(record | {"guard_version": 0}) for record in figures_guard.read_records(path)]
    path.write_text("\n".join(stale) + "\n")
    with pytest.raises(pytest.fail.Exception):
        list(figures_guard.record_cases(path, cases, tmp_path))


def test_a_table_names_what_was_changed_and_whom_the_ego_met(tmp_path):
    record = {
        "scenario": "b-v1", "tc": 7.0, "driver": "random", "episodes": 1000, "collisions": 3, "ego_at_fault": 0,
        "pedestrian": 2, "ahead": 0, "side": 1, "rear_ended": 0, "intervention_ratio": 0.125, "mean_speed_mps": 5.0,
        "worst": [4, 71, 90, 200],
        "options": dataclasses.asdict(GuardOptions(reserve=False)),
    }  # fmt: skip
    (tmp_path / "some.json").write_text(json.dumps(record) + "\n")
    assert figures_guard.table(tmp_path, "some").splitlines()[2] == (
        "| b-v1 | 7 s | random | `reserve=false` | 3/1000 = 0.30 % (0.062 to 0.87) | 0/1000 (<= 0.30 %) "
        "| pedestrian 2, side 1 | 12.5 % | 5.00 m/s | 4, 71, 90 |"
    )


def test_an_unknown_set_is_refused(tmp_path):
    with pytest.raises(UsageError, match="random-actions"):
        list(figures_guard.command(tmp_path, "all", None, 1))


@pytest.mark.parametrize("name", figures_guard.CASES)
def test_the_documentation_shows_the_records(name):
    root = Path(__file__).parents[2]
    assert figures_guard.table(root / "results" / "stress", name) in (root / "docs" / "guard.md").read_text()

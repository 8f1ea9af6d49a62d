"""A replay shows what was recorded, to the bit, or is refused."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from algorithms.risk_model import adjustment_time
from algorithms.safety_guard import SafetyGuard
from bench.errors import RecordError, UsageError
from bench.evaluate import WORLDS, evaluate
from bench.records import find_record, read_record
from bench.replay import command
from bench.replay.choice import choose_episode
from bench.replay.held_out import ReplayDiffersError, replay
from envs.scenario import get_scenario
from envs.world import EPISODE, Ending
from tests.bench.policy_records import network_policy, reference_policy, risk_policy, write_record

MORE_THAN_WORLDS = WORLDS + 30
"""Episodes of which the last begin where others have ended."""


@pytest.mark.parametrize(
    ("method", "policy"),
    [
        ("sac", network_policy),
        ("safety-guard:tc=1.0", lambda: network_policy(SafetyGuard(1.0))),
        # Draws from one generator for all worlds: only the whole evaluation gives its episodes again.
        ("random+guard", lambda: reference_policy("random+guard")),
    ],
)
def test_episodes_of_an_evaluation_come_out_to_the_bit(method: str, policy: object, tmp_path: Path) -> None:
    record = read_record(write_record(tmp_path, method, policy(), episodes=MORE_THAN_WORLDS))
    evaluated = evaluate(policy(), get_scenario("a"), MORE_THAN_WORLDS)
    numbers = [MORE_THAN_WORLDS - 1, 3]
    shown = replay(record, numbers)
    for one, number in zip(shown, numbers, strict=True):
        for name in set(EPISODE.names) - {"world", "end_step"}:
            assert one.trace.episode[-1][name] == evaluated[number][name], name
    assert [one.trace.number for one in shown] == numbers
    assert all(one.exact for one in shown)
    assert (shown[0].guard is None) == (method == "sac")


def test_the_guards_view_goes_with_the_steps(tmp_path: Path) -> None:
    record = read_record(write_record(tmp_path, "dd-rq", risk_policy("b"), "b"))
    (shown,) = replay(record, [2])
    trace, guard = shown.trace, shown.guard
    assert shown.exact
    assert guard is not None
    assert len(guard.tc_s) == len(trace)
    np.testing.assert_array_equal(guard.tc_s, adjustment_time(guard.risk_percent))
    assert guard.importance.shape == (len(trace), trace.vehicles.shape[1] + trace.pedestrians.shape[1])
    seen = guard.importance.sum(axis=1)
    np.testing.assert_allclose(seen[seen > 0.0], 1.0, rtol=1e-5)
    # An acceleration that the bodies ahead do not allow was never carried out, but for full braking.
    allowed = np.maximum(guard.limit_ahead_mps2, -2.0)
    assert (trace.executed[:, 1] <= allowed + 1e-9).all()
    # RQ is held for a decision of five steps.
    assert (guard.risk_percent[0:5] == guard.risk_percent[0]).all()


@pytest.mark.parametrize(
    ("name", "value"), [("steps", 7), ("ending", Ending.OFF_ROAD), ("distance", 1.0), ("interventions", 3)]
)
def test_a_replay_that_differs_is_refused_and_says_in_what(name: str, value: float, tmp_path: Path) -> None:
    path = write_record(tmp_path, "constant-speed", reference_policy("constant-speed"), change={(4, name): value})
    with pytest.raises(ReplayDiffersError, match=rf"episode 4, comes out otherwise.*{name}: .*It is not shown"):
        replay(read_record(path), [4])


def test_a_difference_of_rounding_is_shown_and_marked(tmp_path: Path) -> None:
    policy = reference_policy("constant-speed")
    plain = read_record(write_record(tmp_path / "plain", "constant-speed", policy))
    distance = float(plain.eval_episodes().column("distance")[4].as_py())
    record = read_record(
        write_record(tmp_path / "other", "constant-speed", policy, change={(4, "distance"): distance * (1 + 5e-5)})
    )
    first, other = replay(record, [3, 4])
    assert (first.exact, other.exact) == (True, False)


def test_a_record_without_a_policy_says_what_to_do(tmp_path: Path) -> None:
    path = write_record(tmp_path, "constant-speed", reference_policy("constant-speed"))
    shutil.rmtree(path / "policy")
    with pytest.raises(UsageError, match=r"holds no policy .* run constant-speed on a-v1, seed 0 again"):
        replay(read_record(path), [0])


def test_a_changed_policy_is_not_driven(tmp_path: Path) -> None:
    path = write_record(tmp_path, "sac", network_policy())
    with (path / "policy" / "actor.json").open("a") as file:
        file.write(" ")
    with pytest.raises(RecordError, match=r"policy/actor\.json is not what was sealed"):
        replay(read_record(path), [0])


def test_a_run_is_found_by_any_part_of_its_name_that_no_other_has(tmp_path: Path) -> None:
    policy = reference_policy("constant-speed")
    paths = [write_record(tmp_path, "constant-speed", policy, scenario) for scenario in ("a", "b")]
    for text in ("b-v1", paths[1].name, str(paths[1]), paths[1].name[-12:]):
        assert find_record(tmp_path, text).path == paths[1]
    with pytest.raises(UsageError, match=rf"fits 2 runs(.|\n)*{paths[0].name}"):
        find_record(tmp_path, "constant")
    with pytest.raises(UsageError, match="no folder with this in its name"):
        find_record(tmp_path, "cruise")
    (paths[0] / "DONE").unlink()
    with pytest.raises(UsageError, match="only a finished run"):
        find_record(tmp_path, "a-v1")


def test_worst_is_a_collision_and_closest_the_nearest_miss(tmp_path: Path) -> None:
    times = {(k, "ttc_min"): 5.0 - 0.1 * k for k in range(12)}
    hits = {(k, "ending"): Ending.COLLISION for k in (7, 11)}
    ends = {(k, "ending"): Ending.GOAL for k in range(12) if k not in (7, 11)}
    policy = reference_policy("constant-speed")
    hit = read_record(write_record(tmp_path / "hit", "constant-speed", policy, change=times | ends | hits))
    assert choose_episode(hit.eval_episodes(), "worst") == 7
    assert choose_episode(hit.eval_episodes(), "closest") == 10
    safe = read_record(
        write_record(
            tmp_path / "safe", "constant-speed", policy, change=times | ends | {(7, "ending"): 1, (11, "ending"): 1}
        )
    )
    assert choose_episode(safe.eval_episodes(), "worst") == 11
    assert choose_episode(safe.eval_episodes(), "3") == 3
    for text in ("12", "-1", "first", ""):
        with pytest.raises(UsageError, match="a number from 0 to 11"):
            choose_episode(safe.eval_episodes(), text)


def test_two_methods_are_compared_on_the_same_episode_only(tmp_path: Path) -> None:
    write_record(tmp_path, "constant-speed", reference_policy("constant-speed"))
    write_record(tmp_path, "cruise", reference_policy("cruise"), episodes=4)
    write_record(tmp_path, "idm", reference_policy("idm", "b"), "b", 4)
    first, second = command.replays("constant", "2", "cruise", tmp_path)
    assert (first.trace.ego[0], first.trace.number) == (second.trace.ego[0], second.trace.number)
    assert (first.trace.vehicles[0] == second.trace.vehicles[0]).all()
    with pytest.raises(UsageError, match="share no episodes"):
        command.replays("constant", "2", "idm", tmp_path)
    with pytest.raises(UsageError, match="held-out episodes 0 to 3, not 5"):
        command.replays("constant", "5", "cruise", tmp_path)
    with pytest.raises(UsageError, match="a stress test and a record"):
        command.replays("constant", "2", "stress:a", tmp_path)


def test_a_summary_gives_the_recorded_figures(tmp_path: Path) -> None:
    path = write_record(tmp_path, "constant-speed", reference_policy("constant-speed"))
    (values,) = command.as_values(command.replays(path.name, "5", None, tmp_path))
    row = {name: column[5] for name, column in read_record(path).eval_episodes().to_pydict().items()}
    assert values["steps"] == row["steps"]
    assert values["ending"] == Ending(row["ending"]).name.lower().replace("_", "-")
    assert values["distance_m"] == pytest.approx(row["distance"], abs=0.05)
    assert json.loads(json.dumps(values)) == values
    assert "every figure the same" in command.as_text(command.replays(path.name, "5", None, tmp_path))

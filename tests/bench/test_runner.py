"""One specification gives one record, the same bytes each time; a failure says where and leaves no record."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from algorithms.atomic import files_below
from algorithms.checkpoints import Interval
from algorithms.method import Observations, Policy
from algorithms.registry import get_method
from bench import store
from bench.errors import AlreadyDoneError, RunFailedError
from bench.evaluate import evaluate
from bench.records import collect
from bench.runner import run
from bench.spec import RunSpec
from bench.store import State, Store
from envs.driving_env import ActionMode, CostSignal
from envs.scenario import get_scenario
from envs.world import Ending

Make = Callable[..., RunSpec]


class Cautious(Policy):
    """Half speed, lane kept; counts how often it is begun."""

    def __init__(self, action: tuple[float, ...] = (0.0, 0.0)) -> None:
        self.action = np.array(action)
        self.begun: list[tuple[int, int]] = []

    def begin(self, worlds: int, seed: np.random.SeedSequence) -> None:
        self.begun.append((worlds, int(seed.generate_state(1)[0])))

    def act(self, observations: Observations) -> np.ndarray:
        return np.tile(self.action, (len(observations), 1))

    def save(self, folder: Path) -> None:
        raise NotImplementedError


@pytest.mark.parametrize("episodes", [1, 255, 256, 300])
def test_every_held_out_episode_comes_exactly_once_and_in_order(episodes: int) -> None:
    records = evaluate(Cautious(), get_scenario("b"), episodes)
    assert records["episode"].tolist() == list(range(episodes))
    assert (records["ending"] != Ending.RUNNING).all()


def test_a_longer_list_begins_with_the_shorter_one() -> None:
    short = evaluate(Cautious(), get_scenario("a"), 40)
    long = evaluate(Cautious(), get_scenario("a"), 300)
    for name in ("steps", "ending", "distance", "return_driving"):
        np.testing.assert_array_equal(long[name][:40], short[name])


def test_the_policy_is_begun_once_with_the_stream_of_the_scenario() -> None:
    policy = Cautious()
    evaluate(policy, get_scenario("a"), 3)
    evaluate(policy, get_scenario("a"), 3)
    first, second = policy.begun
    assert first == second
    assert first[0] == 256


def test_the_planning_action_mode_is_honoured() -> None:
    policy = Cautious((2.0, 0.0, 9.0))
    policy.action_mode = ActionMode.PLANNING
    assert len(evaluate(policy, get_scenario("a"), 3)) == 3


def test_the_cost_signal_reaches_the_records() -> None:
    collisions = evaluate(Cautious(), get_scenario("a"), 60)
    proximity = evaluate(Cautious(), get_scenario("a"), 60, cost_signal=CostSignal.PROXIMITY)
    assert proximity["cost"].sum() > collisions["cost"].sum()


def test_a_policy_that_gives_nan_is_an_error() -> None:
    with pytest.raises(ValueError, match="must be finite"):
        evaluate(Cautious((0.0, float("nan"))), get_scenario("a"), 3)


def test_a_run_leaves_a_complete_record(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    reports: list[tuple[str, int, int]] = []
    record = run(make_spec(), tmp_path, lambda stage, done, total, _: reports.append((stage, done, total)))
    assert {path.relative_to(record.path).as_posix() for path in files_below(record.path)} == {
        "DONE",
        "run.json",
        "train_episodes.parquet",
        "eval_episodes.parquet",
        "scalars.parquet",
        "policy/action.json",
    }
    assert record.spec == make_spec()
    assert record.details["steps_done"] == 2_000
    assert set(record.details["timing"]) == {"train", "evaluate"}
    assert record.eval_episodes().num_rows == 20
    trained = record.train_episodes()
    assert trained.num_rows > 0
    assert max(trained.column("end_step").to_pylist()) <= 2_000
    assert record.scalars().to_pylist()[0] == {"steps": 200, "name": "loss", "value": 0.1}
    assert ("train", 2_000, 2_000) in reports
    assert ("evaluate", 20, 20) in reports


def test_the_same_specification_gives_the_same_bytes_whatever_ran_before(
    fakes: Path, tmp_path: Path, make_spec: Make
) -> None:
    first = run(make_spec(), tmp_path / "1")
    run(make_spec(seed=1), tmp_path / "2")
    second = run(make_spec(), tmp_path / "2")
    for path in files_below(first.path):
        if path.suffix == ".parquet" or path.parent.name == store.POLICY_FOLDER:
            assert path.read_bytes() == (second.path / path.relative_to(first.path)).read_bytes(), path.name


def test_another_seed_trains_on_other_episodes_and_is_judged_on_the_same(
    fakes: Path, tmp_path: Path, make_spec: Make
) -> None:
    first, second = run(make_spec(), tmp_path), run(make_spec(seed=1), tmp_path)
    assert first.train_episodes() != second.train_episodes()
    assert first.eval_episodes() == second.eval_episodes(), "the fake policy is the same for every seed"


def test_sac_gives_the_same_bytes_twice(tmp_path: Path, make_spec: Make) -> None:
    spec = make_spec(method="sac", method_version=get_method("sac").version, steps=1_600, eval_episodes=8)
    # Taking a checkpoint changes nothing.
    first, second = run(spec, tmp_path / "1"), run(spec, tmp_path / "2", checkpoint_every=Interval(1e9, 400))
    assert first.seals.keys() == second.seals.keys()
    same = {name for name in first.seals if first.seals[name] == second.seals[name]}
    assert set(first.seals) - same == {store.RUN_FILE}


def test_the_first_amount_told_of_a_training_is_where_it_goes_on_from(tmp_path: Path, make_spec: Make) -> None:
    spec = make_spec(method="sac", method_version=get_method("sac").version, steps=1_600, eval_episodes=8)
    told: list[int] = []

    def stop(stage: str, done: int, *_: object) -> None:
        told.append(done)
        if stage == "train" and done >= 1_200:
            raise SystemExit

    with pytest.raises(SystemExit):
        run(spec, tmp_path, stop, checkpoint_every=Interval(1e9, 400))
    assert told[0] == 0
    told.clear()
    run(spec, tmp_path, lambda stage, done, *_: told.append(done) if stage == "train" else None)
    assert 400 <= told[0] < 1_600


def test_a_done_run_is_not_run_again(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    run(make_spec(), tmp_path)
    with pytest.raises(AlreadyDoneError):
        run(make_spec(), tmp_path)


def test_a_driver_that_does_not_train_has_no_t_stage(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    record = run(make_spec(method="fake-scripted", steps=0), tmp_path)
    assert record.train_episodes().num_rows == 0
    assert record.scalars().num_rows == 0
    assert record.details["trains"] is False


@pytest.mark.parametrize(
    ("method", "reason"),
    [
        ("fake-failing", r"step 240 \(train\): RuntimeError: the learner tripped"),
        ("fake-diverging", r"step 140 \(train\): loss is nan at simulation step 140"),
        ("fake-greedy", r"step 2000 \(train\): BudgetExceededError: The budget of 100 decisions"),
        ("broken", r"step 0 \(setup\): UnavailableError"),
    ],
)
def test_a_failure_names_stage_step_and_reason(
    fakes: Path, tmp_path: Path, make_spec: Make, method: str, reason: str
) -> None:
    spec = make_spec(method=method)
    with pytest.raises(RunFailedError, match=reason):
        run(spec, tmp_path)
    assert Store(tmp_path).state(spec) is State.FAILED
    (missing,) = collect(tmp_path).missing
    assert missing.failure is not None
    assert re.search(reason, f"step {missing.failure.step} ({missing.failure.stage}): {missing.failure.reason}")


def test_a_traceback_holds_no_absolute_path(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    spec = make_spec(method="fake-failing")
    with pytest.raises(RunFailedError):
        run(spec, tmp_path)
    text = (Store(tmp_path).folder(spec) / store.FAILED_FILE).read_text()
    assert "the learner tripped" in text
    assert 'File \\"/' not in text


def test_a_method_of_another_version_is_refused(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    with pytest.raises(RunFailedError, match="this is version 1"):
        run(make_spec(method_version=2), tmp_path)


def test_a_stopped_run_is_as_if_never_begun(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    def stop(stage: str, done: int, *_: object) -> None:
        if done:
            raise SystemExit

    with pytest.raises(SystemExit):
        run(make_spec(), tmp_path, stop)
    assert Store(tmp_path).state(make_spec()) is State.UNFINISHED
    run(make_spec(), tmp_path)
    assert Store(tmp_path).state(make_spec()) is State.DONE


def test_the_provenance_names_code_and_machine_but_no_host_user_or_path(
    fakes: Path, tmp_path: Path, make_spec: Make
) -> None:
    record = run(make_spec(), tmp_path)
    content = json.loads((record.path / store.RUN_FILE).read_text())
    found = content["provenance"]
    assert set(found["git"]) == {"commit", "dirty", "diff_sha256"}
    assert {"numpy", "torch", "numba", "gymnasium"} <= set(found["packages"])
    assert re.fullmatch(r"[0-9a-f]{64}", found["source_sha256"])
    assert "/" not in json.dumps({key: value for key, value in content.items() if key != "spec"})

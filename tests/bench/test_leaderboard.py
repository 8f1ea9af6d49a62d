"""Rows pool counts over seeds, never over budgets; the same records give the same bytes, fast."""

import csv
import hashlib
import math
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pytest

from bench import leaderboard, schema, store
from bench.errors import RecordError
from bench.leaderboard import COLUMNS, rows, to_csv, to_markdown
from bench.records import collect
from bench.statistics import exact_rate

MakeRecord = Callable[..., Path]
REQUIRED = (
    "method", "scenario", "stage", "seeds", "episodes", "collision_rate", "collision_low", "collision_high",
    "ego_at_fault", "pedestrian_collisions", "speed_mps", "intervention_ratio", "return_without_risk",
)  # fmt: skip


def test_seeds_are_pooled_and_every_figure_is_the_one_worked_by_hand(tmp_path: Path, make_record: MakeRecord) -> None:
    make_record(tmp_path, collisions=2, train_collisions=10)
    make_record(tmp_path, collisions=3, train_collisions=15, seed=1)
    applied, trained = rows(collect(tmp_path).records)
    assert (applied["stage"], trained["stage"]) == ("A", "T")
    assert (applied["seeds"], applied["episodes"], applied["collisions"]) == (2, 40, 5)
    assert applied["collision_rate"] == pytest.approx(0.125)
    # Both seeds drive the same 20 episodes, and each trains on its own.
    assert (applied["scenarios"], trained["scenarios"]) == (20, 100)
    for row, exact in ((applied, exact_rate(5, 40, independent=20)), (trained, exact_rate(25, 100))):
        assert (row["collision_low"], row["collision_high"]) == (exact.low, exact.high)
    assert applied["collisions_by_seed"] == "2/20 3/20"
    assert (applied["ego_at_fault"], applied["side_collisions"], applied["pedestrian_collisions"]) == (5, 5, 0)
    assert applied["speed_mps"] == pytest.approx(12.0, rel=1e-5)  # 1.2 m in each step of 0.1 s
    assert applied["goal"] == pytest.approx(35 / 40)
    assert applied["goal"] + applied["collision"] + applied["off_road"] + applied["time_out"] == pytest.approx(1.0)
    assert applied["return_comfort"] == pytest.approx(-1.0)
    assert applied["return_without_risk"] == pytest.approx(applied["return_driving"] - 1.0)
    # Of episodes 0 to 19 every fourth is inf, the others 1 + i % 7: nine are below 5, two are 5, four above, five inf.
    assert applied["ttc_min_median_s"] == 5.0
    assert (applied["wall_s"], trained["wall_s"]) == (1.0, 2.0)
    assert trained["collision_rate"] == pytest.approx(0.25)


def test_the_csv_has_all_promised_columns_and_one_row_for_each_stage(tmp_path: Path, make_record: MakeRecord) -> None:
    make_record(tmp_path)
    leaderboard.write(tmp_path, rows(collect(tmp_path).records))
    with (tmp_path / "leaderboard.csv").open() as file:
        read = list(csv.DictReader(file))
    assert [row["stage"] for row in read] == ["A", "T"]
    assert set(REQUIRED) <= set(read[0])
    assert list(read[0]) == list(COLUMNS)
    assert "| 0/20 (<= 14.0 %) |" in (tmp_path / "leaderboard.md").read_text()


def test_other_budgets_costs_and_settings_are_rows_of_their_own(tmp_path: Path, make_record: MakeRecord) -> None:
    for change in ({}, {"steps": 4_000}, {"eval_episodes": 30}, {"cost_limit": 0.1}, {"settings": {"pace": "2"}}):
        make_record(tmp_path, **change)
    found = rows(collect(tmp_path).records)
    assert len(found) == 2 * 5
    assert {row["seeds"] for row in found} == {1}


def test_a_driver_that_does_not_train_has_no_t_row(tmp_path: Path, make_record: MakeRecord) -> None:
    make_record(tmp_path, steps=0)
    assert [row["stage"] for row in rows(collect(tmp_path).records)] == ["A"]


def test_a_training_stage_without_a_finished_episode_is_an_empty_row_not_an_error(
    tmp_path: Path, make_record: MakeRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_record(tmp_path)
    from bench.records import Record

    whole = Record.train_episodes
    monkeypatch.setattr(Record, "train_episodes", lambda record: whole(record).slice(0, 0))
    trained = rows(collect(tmp_path).records)[1]
    assert trained["episodes"] == 0
    assert math.isnan(trained["speed_mps"])
    assert "no episodes" in to_markdown([trained])
    assert ",,," in to_csv([trained])


def test_safe_comes_before_fast_and_a_tie_on_safety_is_broken_by_speed(
    tmp_path: Path, make_record: MakeRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, collisions in (("reckless", 150), ("careful", 0), ("nearly-careful", 1)):
        make_record(tmp_path, method=name, steps=0, eval_episodes=200, collisions=collisions)
    speeds = {"reckless": 13.0, "careful": 10.0, "nearly-careful": 11.0}
    figures = leaderboard._row

    def row_with_speed(*arguments: object) -> dict[str, object]:
        row = figures(*arguments)  # type: ignore[arg-type]
        return {**row, "speed_mps": speeds[row["method"]]}

    monkeypatch.setattr(leaderboard, "_row", row_with_speed)
    ranked = rows(collect(tmp_path).records)
    assert [(row["rank"], row["method"]) for row in ranked] == [
        (1, "nearly-careful"),
        (2, "careful"),
        (3, "reckless"),
    ]


def test_the_same_records_give_the_same_bytes(tmp_path: Path, make_record: MakeRecord) -> None:
    for seed in range(3):
        make_record(tmp_path / "1", seed=seed, collisions=seed)
    shutil.copytree(tmp_path / "1", tmp_path / "2")
    for results in (tmp_path / "1", tmp_path / "2"):
        leaderboard.write(results, rows(collect(results).records))
    for name in ("leaderboard.csv", "leaderboard.md"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()


@pytest.mark.slow
def test_200_runs_of_10000_episodes_aggregate_within_10_s(tmp_path: Path, make_record: MakeRecord) -> None:
    for seed in range(200):
        make_record(tmp_path, method=f"m{seed % 20}", seed=seed, eval_episodes=10_000, collisions=seed)
    start = time.process_time()
    found = rows(collect(tmp_path).records)
    assert time.process_time() - start < 10.0
    assert sum(row["episodes"] for row in found if row["stage"] == "A") == 2_000_000


def test_every_column_is_documented_as_the_code_describes_it() -> None:
    text = (Path(__file__).resolve().parents[2] / "docs" / "results.md").read_text()
    assert leaderboard.RANKING in text
    assert [name for name, meaning in COLUMNS.items() if f"| `{name}` | {meaning} |" not in text] == []


@pytest.mark.parametrize("name", ["return_driving", "ttc_min"])
def test_a_record_that_holds_nan_is_refused_by_name(tmp_path: Path, make_record: MakeRecord, name: str) -> None:
    make_record(tmp_path)
    (record,) = collect(tmp_path).records
    table = record.eval_episodes()
    at = table.column_names.index(name)
    values = table.column(name).to_numpy().copy()
    values[3] = math.nan
    content = schema.to_bytes(table.set_column(at, table.schema.field(name), pa.array(values)))
    (record.path / store.EVAL_FILE).write_bytes(content)
    record.seals[store.EVAL_FILE] = hashlib.sha256(content).hexdigest()
    with pytest.raises(RecordError, match=f"a-v1_fake-learner_s0_.*: {name} of stage A holds NaN"):
        rows([record])


def test_one_seed_says_nothing_of_new_ones(tmp_path: Path, make_record: MakeRecord) -> None:
    make_record(tmp_path, method="sac", collisions=5)
    for seed in range(2):
        make_record(tmp_path, method="cpo", collisions=5, seed=seed)
    found = {row["method"]: row for row in rows(collect(tmp_path).records) if row["stage"] == "A"}
    assert math.isnan(found["sac"]["collision_seeds_low"])
    assert found["sac"]["collision_low"] > 0.0
    assert 0.0 < found["cpo"]["collision_seeds_low"] < 0.25 < found["cpo"]["collision_seeds_high"]


def test_a_faster_method_that_collides_clearly_more_is_not_tied_with_a_safe_one_of_uneven_seeds(
    tmp_path: Path, make_record: MakeRecord
) -> None:
    for seed, (uneven, often) in enumerate(((2, 36), (3, 40), (1, 44), (25, 40))):
        make_record(tmp_path, method="cpo", collisions=uneven, seed=seed, eval_episodes=100, look={"speed_mps": 5.0})
        make_record(tmp_path, method="sac", collisions=often, seed=seed, eval_episodes=100, look={"speed_mps": 13.0})
    found = [row for row in rows(collect(tmp_path).records) if row["stage"] == "A"]
    assert found[1]["collision_seeds_low"] < found[0]["collision_seeds_high"], "the intervals of 95 % overlap"
    assert [(row["rank"], row["method"]) for row in found] == [(1, "cpo"), (2, "sac")]

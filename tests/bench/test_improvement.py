"""Speed and return as interquartile means, and how probably our method exceeds another."""

import csv
from collections.abc import Callable
from pathlib import Path

import pytest

from bench import improvement
from bench.records import collect

MakeRecord = Callable[..., Path]
FULL = {"steps": 500_000, "eval_episodes": 20}


@pytest.fixture
def found(tmp_path: Path, make_record: MakeRecord) -> dict[str, improvement.Row]:
    for seed, pace in enumerate((11.0, 12.0, 13.0)):
        make_record(tmp_path, method="dd-rq", seed=seed, look={"speed_mps": pace, "pay": 3.0}, **FULL)
        make_record(tmp_path, method="sac", seed=seed, look={"speed_mps": pace + 0.5, "pay": 1.0}, **FULL)
    make_record(tmp_path, method="cpo", look={"speed_mps": 11.5, "pay": 2.0}, **FULL)
    return {row["method"]: row for row in improvement.rows(collect(tmp_path))}


def test_interquartile_means_leave_the_outer_quarters_out(found: dict[str, improvement.Row]) -> None:
    # 20 episodes each of 11, 12 and 13 m/s: of 60 the 15 slowest and 15 fastest go.
    assert float(found["dd-rq"]["speed_iqm"]) == pytest.approx((5 * 11 + 20 * 12 + 5 * 13) / 30, rel=1e-5)
    assert float(found["sac"]["speed_iqm"]) == pytest.approx(12.5, rel=1e-5)
    assert float(found["dd-rq"]["speed_iqm_low"]) < 12.0 < float(found["dd-rq"]["speed_iqm_high"])


def test_the_probability_is_that_ours_exceeds_theirs(found: dict[str, improvement.Row]) -> None:
    # Of nine pairs of seeds ours is the faster in 12 over 11.5, 13 over 11.5 and 13 over 12.5.
    assert float(found["sac"]["speed_dd-rq_improves"]) == pytest.approx(3 / 9, rel=1e-5)
    assert float(found["cpo"]["speed_dd-rq_improves"]) == pytest.approx(2 / 3, rel=1e-5)
    assert float(found["sac"]["return_dd-rq_improves"]) > 0.5


def test_what_cannot_be_said_is_left_empty(found: dict[str, improvement.Row]) -> None:
    assert found["dd-rq"]["speed_dd-rq_improves"] == ""
    assert found["sac"]["speed_dd-rq-plus_improves"] == ""
    assert found["cpo"]["speed_iqm"]
    assert found["cpo"]["speed_iqm_low"] == found["cpo"]["speed_dd-rq_improves_low"] == ""


def test_lists_of_other_lengths_are_not_compared(tmp_path: Path, make_record: MakeRecord) -> None:
    make_record(tmp_path, method="dd-rq", **FULL)
    make_record(tmp_path, method="idm", steps=0, eval_episodes=30)
    rows = {row["method"]: row for row in improvement.rows(collect(tmp_path))}
    assert rows["idm"]["speed_iqm"]
    assert rows["idm"]["speed_dd-rq_improves"] == ""


def test_both_files_say_the_same_and_always_in_the_same_bytes(
    tmp_path: Path, found: dict[str, improvement.Row]
) -> None:
    written = improvement.write(tmp_path, list(found.values()))
    first = [path.read_bytes() for path in written]
    improvement.write(tmp_path, improvement.rows(collect(tmp_path)))
    assert [path.read_bytes() for path in written] == first
    read = list(csv.DictReader(first[0].decode().splitlines()))
    assert read == list(found.values())
    assert "| cpo | 1 | 11.50 |" in first[1].decode()


def test_nothing_recorded_gives_a_table_without_rows(tmp_path: Path, make_record: MakeRecord) -> None:
    (tmp_path / "runs").mkdir()
    paths = improvement.write(tmp_path, improvement.rows(collect(tmp_path)))
    assert paths[0].read_text() == "scenario,method,seeds\n"

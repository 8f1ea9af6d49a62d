"""Every figure of the tables and the leaderboard is traced to its records and computed again from them."""

import csv
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bench import leaderboard, tables, why
from bench.cli.commands import app
from bench.errors import UsageError
from bench.records import collect
from bench.why.queries import of_leaderboard

MakeRecord = Callable[..., Path]


@pytest.fixture(scope="module")
def drawn(standard_results: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the records with tables and leaderboard beside them. Read only."""
    results = tmp_path_factory.mktemp("drawn") / "results"
    shutil.copytree(standard_results, results)
    collection = collect(results)
    tables.write(collection, results / "paper_tables")
    leaderboard.write(results, leaderboard.rows(collection.records))
    return results


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("table", ["ablation", "collision"])
def test_every_cell_of_a_table_is_what_its_query_gives(drawn: Path, table: str) -> None:
    collection = collect(drawn)
    for row in _rows(drawn / "paper_tables" / f"{table}.csv"):
        address = why.parse(table, [row["column"], row["row"], row["stage"]])
        found = why.trace(address, collection, drawn / "paper_tables")
        assert found.stated == row["value"]
        assert found.value == row["value"], found.cell
        assert found.method == row["method"]
        assert len(found.records) == 3


def test_every_figure_of_the_leaderboard_is_what_its_query_gives(drawn: Path) -> None:
    collection = collect(drawn)
    for row in _rows(drawn / "leaderboard.csv"):
        if (row["method"], row["scenario"]) != ("sac", "b-v1"):
            continue
        for name in of_leaderboard(row["stage"]):
            address = why.parse("leaderboard", [row["method"], name, row["stage"], row["scenario"]])
            found = why.trace(address, collection, drawn)
            assert (found.stated, found.value) == (row[name], row[name]), found.cell


def test_queries_cover_every_figure_of_the_leaderboard() -> None:
    stated = {
        "rank", "method", "method_version", "scenario", "stage", "steps", "eval_episodes", "cost_limit", "cost_signal",
        "settings", "seeds", "collisions_by_seed", "wall_s", "cpu_s", "steps_per_s", "commit",
    }  # fmt: skip
    for stage in "TA":
        assert set(of_leaderboard(stage)) | stated == set(leaderboard.COLUMNS)


def test_a_trace_names_records_seeds_commit_and_query(drawn: Path) -> None:
    result = CliRunner().invoke(app, ["why", "ablation", "dd-rq", "Collision Rate", "A", "--results", str(drawn)])
    assert result.exit_code == 0, result.output
    assert "collisions of these policies 0/7500 (<= 0.12 %)" in result.output  # three seeds, the same 2,500 episodes
    assert 'ablation dd-rq "Collision Rate" A: 0 (as ' in result.output
    assert "100 * sum(ending = 2) / count(*)" in result.output
    assert "ending of eval_episodes.parquet" in result.output
    assert "0 %, Table 'Results of the ablation experiments'" in result.output
    for seed in range(3):
        assert f"seed {seed}   a-v1_dd-rq_s{seed}_" in result.output
    assert f"at commit {'0' * 40}" in result.output


def test_a_table_that_says_something_else_is_found_out(drawn: Path, tmp_path: Path) -> None:
    shutil.copytree(drawn, tmp_path / "results")
    path = tmp_path / "results" / "leaderboard.csv"
    path.write_text(path.read_text().replace("3000/7500", "x").replace(",3000,", ",2999,"))
    arguments = ["why", "leaderboard", "sac", "collisions", "A", "a", "--results", str(tmp_path / "results")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    assert "leaderboard.csv says 2999: draw it again" in result.output


def test_an_empty_cell_says_why(tmp_path: Path, make_record: MakeRecord) -> None:
    make_record(tmp_path, method="sac")
    found = why.trace(why.parse("ablation", ["Ours", "speed_mps", "T"]), collect(tmp_path), tmp_path)
    assert (found.value, found.stated, found.records) == ("", None, ())
    assert found.reason.startswith("no run; bench run --algo dd-rq")
    assert "missing  no run" in why.as_text(found)


def test_rows_of_one_method_are_told_apart_by_what_differs(tmp_path: Path, make_record: MakeRecord) -> None:
    for steps in (2_000, 4_000):
        make_record(tmp_path, method="sac", steps=steps)
    collection = collect(tmp_path)
    with pytest.raises(UsageError, match=r"2 rows; add one of: a-v1 steps=\d000; a-v1 steps=\d000\."):
        why.trace(why.parse("leaderboard", ["sac", "goal", "T"]), collection, tmp_path)
    found = why.trace(why.parse("leaderboard", ["sac", "goal", "T", "steps=4000"]), collection, tmp_path)
    assert [record.spec.steps for record in found.records] == [4_000]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["ablatoin", "sac", "speed_mps", "T"], "Did you mean ablation"),
        (["ablation", "sac", "speed_mps"], "give METHOD FIGURE STAGE"),
        (["ablation", "sac", "speed_mps", "T", "a"], "give METHOD FIGURE STAGE"),
        (["ablation", "sac", "speed_mps", "B"], "give T .training. or A"),
        (["ablation", "sack", "speed_mps", "T"], "Did you mean sac"),
        (["ablation", "sac", "sped_mps", "T"], "Did you mean speed_mps"),
        (["leaderboard", "sac", "sped_mps", "T"], "Did you mean speed_mps"),
        (["leaderboard", "sac", "speed_mps", "T", "a", "b"], "'b' is no COLUMN=VALUE"),
        (["leaderboard", "sac", "speed_mps", "T", "step=5"], "Did you mean steps"),
        (["leaderboard", "ppo", "speed_mps", "T"], "no such row in the leaderboard. It has: "),
    ],
)
def test_an_address_without_a_cell_is_refused_with_what_there_is(drawn: Path, words: list[str], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        why.trace(why.parse(words[0], words[1:]), collect(drawn), drawn)

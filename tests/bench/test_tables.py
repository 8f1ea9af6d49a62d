"""Both tables of the paper, ours beside the published figures; what is missing says why."""

import csv
import io
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from bench import tables
from bench.published import CONTROLS, read_figures
from bench.records import collect
from bench.spec import RunSpec
from bench.store import Failure, Store
from bench.table_files import escape

MakeRecord = Callable[..., Path]
Make = Callable[..., RunSpec]
FULL = {"steps": 500_000, "eval_episodes": 400}


def _drawn(results: Path, steps: int | None = None) -> dict[str, str]:
    return {path.name: path.read_text() for path in tables.write(collect(results), results / "tables", steps)}


def _cells(text: str) -> dict[tuple[str, str, str], dict[str, str]]:
    return {(row["metric"], row["column"], row["stage"]): row for row in csv.DictReader(io.StringIO(text))}


def test_the_published_figures_are_those_of_the_paper() -> None:
    figures = {(f.table, f.metric, f.column, f.stage): f.value for f in read_figures() if f.source}
    assert len(figures) == 36 + 12
    assert figures["ablation", "collision_rate", "SAC", "T"] == "49.7"
    assert figures["ablation", "speed_mps", "Ours", "A"] == "12.66"
    assert figures["ablation", "intervention_ratio", "Tc=7.0", "T"] == "6.2"
    assert figures["ablation", "intervention_ratio", "SAC", "T"] == ""
    assert figures["collision", "collision_rate", "CPO", "A"] == "90"
    assert figures["collision", "collision_rate", "Safety Guard", "T"] == "0.12"


def test_every_row_of_both_tables_has_the_same_columns() -> None:
    for table in ("ablation", "collision"):
        rows: dict[tuple[str, str], list[str]] = {}
        for figure in read_figures():
            if figure.table == table:
                rows.setdefault((figure.row, figure.stage), []).append(figure.column)
        assert len({tuple(columns) for columns in rows.values()}) == 1
        assert next(iter(rows.values()))[len(next(iter(rows.values()))) - len(CONTROLS[table]) :] == [
            column for column, _ in CONTROLS[table]
        ]


def test_our_figures_stand_beside_the_published_ones(tmp_path: Path, make_record: MakeRecord) -> None:
    for seed, collisions in enumerate((100, 120, 110)):
        make_record(tmp_path, method="sac", seed=seed, collisions=collisions, train_collisions=25, **FULL)
    drawn = _drawn(tmp_path)
    cell = _cells(drawn["ablation.csv"])["collision_rate", "SAC", "A"]
    assert (cell["value"], cell["paper"], cell["episodes"], cell["seeds"]) == ("27.5", "27.5", "1200", "3")
    assert float(cell["low"]) < 27.5 < float(cell["high"])
    assert re.search(r"330/1200 = 27\.5 % \(\d+\.\d to \d+\.\d\)", drawn["ablation.md"])
    assert "500,000 training steps of 0.1 s, 400 held-out episodes for each of 3 seeds" in drawn["ablation.md"]
    speed = _cells(drawn["ablation.csv"])["speed_mps", "SAC", "T"]
    assert float(speed["value"]) == pytest.approx(12.0, rel=1e-4)
    assert speed["paper"] == "12.80"


def test_a_zero_is_written_with_its_bound(tmp_path: Path, make_record: MakeRecord) -> None:
    make_record(tmp_path, method="dd-rq", **FULL)
    assert "0/400 (<= 0.75 %)" in _drawn(tmp_path)["ablation.md"]
    assert r"0/400\\(\ensuremath{\le} 0.75 \%)" in _drawn(tmp_path)["ablation.tex"]


def test_a_missing_run_is_an_empty_cell_with_its_reason(
    tmp_path: Path, make_record: MakeRecord, make_spec: Make
) -> None:
    make_record(tmp_path, method="sac", scenario="b", **FULL)
    make_record(tmp_path, method="dd-rq", scenario="b", steps=4_000, eval_episodes=400)
    Store(tmp_path).fail(
        make_spec(method="cpo", scenario="b", **FULL), Failure("train", 700, "loss is nan at simulation step 700.")
    )
    drawn = _drawn(tmp_path)
    cells = {column: row for (_, column, stage), row in _cells(drawn["collision.csv"]).items() if stage == "A"}
    assert len(cells) == 6
    assert {column for column, row in cells.items() if row["value"]} == {"SAC"}
    assert cells["CPO"]["reason"].startswith("seed 0 failed at step 700 (train): loss is nan")
    assert cells["Ours"]["reason"] == "only run with 4,000 steps with 400 episodes"
    assert cells["FOCOPS"]["reason"].startswith("no run; bench run --algo focops --scenario b")
    for note in {row["reason"] for row in cells.values() if row["reason"]}:
        assert note in drawn["collision.md"]
        assert escape(note) in drawn["collision.tex"]


def test_a_lost_seed_is_told_beside_the_others(tmp_path: Path, make_record: MakeRecord, make_spec: Make) -> None:
    make_record(tmp_path, method="sac", **FULL)
    Store(tmp_path).fail(make_spec(method="sac", seed=1, **FULL), Failure("worker", 0, "was killed"))
    cell = _cells(_drawn(tmp_path)["ablation.csv"])["collision_rate", "SAC", "A"]
    assert cell["value"] == "0"
    assert cell["reason"] == "seed 1 failed at step 0 (worker): was killed"


def test_a_table_holds_one_budget_the_one_with_most_columns_or_the_one_asked_for(
    tmp_path: Path, make_record: MakeRecord
) -> None:
    for method in ("sac", "dd-rq"):
        make_record(tmp_path, method=method, steps=4_000)
    make_record(tmp_path, method="sac", steps=1_000_000)
    cells = _cells(_drawn(tmp_path)["ablation.csv"])
    assert cells["collision_rate", "SAC", "A"]["value"] == cells["collision_rate", "Ours", "A"]["value"] == "0"
    chosen = _cells(_drawn(tmp_path, steps=1_000_000)["ablation.csv"])
    assert chosen["collision_rate", "SAC", "A"]["value"] == "0"
    assert chosen["collision_rate", "Ours", "A"]["reason"] == "only run with 4,000 steps with 20 episodes"


def test_runs_with_another_cost_or_settings_are_not_in_the_paper_s_tables(
    tmp_path: Path, make_record: MakeRecord
) -> None:
    make_record(tmp_path, method="sac", cost_limit=0.1)
    make_record(tmp_path, method="sac", settings={"worlds": "4"})
    assert _cells(_drawn(tmp_path)["ablation.csv"])["collision_rate", "SAC", "A"]["value"] == ""


def test_the_same_records_give_the_same_bytes(tmp_path: Path, make_record: MakeRecord) -> None:
    for seed in range(3):
        make_record(tmp_path / "1", method="sac", seed=seed, collisions=seed, **FULL)
    shutil.copytree(tmp_path / "1", tmp_path / "2")
    assert _drawn(tmp_path / "1") == _drawn(tmp_path / "2")


def test_latex_escapes_what_latex_would_read() -> None:
    assert escape("a_b 50 % {x} \\") == r"a\_b 50 \% \{x\} \textbackslash{}"


def test_the_latex_is_well_formed(tmp_path: Path, make_record: MakeRecord) -> None:
    make_record(tmp_path, method="sac", **FULL)
    text = _drawn(tmp_path)["ablation.tex"]
    assert text.count(r"\begin{tabular}") == text.count(r"\end{tabular}")
    assert text.count("{") - text.count(r"\{") == text.count("}") - text.count(r"\}")
    body = [line for line in text.splitlines() if line.endswith(r"\\") and " & " in line]
    assert {line.count(" & ") for line in body} == {3 + 8 - 1}
    assert text.isascii()


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no pdflatex here")
def test_the_latex_compiles(tmp_path: Path, make_record: MakeRecord) -> None:
    make_record(tmp_path, method="sac", **FULL)
    drawn = _drawn(tmp_path)
    body = drawn["ablation.tex"] + drawn["collision.tex"]
    document = f"\\documentclass{{article}}\\usepackage{{booktabs}}\\begin{{document}}{body}\\end{{document}}"
    (tmp_path / "x.tex").write_text(document)
    subprocess.run(["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "x.tex"], cwd=tmp_path, check=True)

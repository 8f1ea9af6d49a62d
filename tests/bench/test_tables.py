"""Both tables of the paper, ours beside the published figures; what is missing says why."""

import csv
import io
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from algorithms.registry import get_method
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
    assert "500,000 training steps of 0.1 s, the same 400 held-out episodes for each of 3 seeds" in drawn["ablation.md"]
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
    # The paper's six columns, and below them our two.
    assert {line.count(" & ") for line in body} == {3 + 6 - 1, 3 + 2 - 1}
    assert text.isascii()


ENGINE = next(filter(shutil.which, ("pdflatex", "lualatex", "xelatex")), None)


@pytest.mark.skipif(ENGINE is None, reason="no TeX engine here")
def test_the_latex_compiles(standard_results: Path, tmp_path: Path) -> None:
    drawn = [path.read_text() for path in tables.write(collect(standard_results), tmp_path) if path.suffix == ".tex"]
    head = "\\documentclass{article}\\usepackage{booktabs}\\usepackage[textwidth=516pt]{geometry}\\begin{document}"
    document = [head, *drawn, "\\end{document}"]
    (tmp_path / "x.tex").write_text("\n".join(document))
    command = [ENGINE, "-interaction=nonstopmode", "-halt-on-error", "x.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:]
    assert "Overfull" not in done.stdout, "wider than the page of a two-column journal"


def test_published_methods_have_their_canonical_names() -> None:
    # A parameter at its default is left out in records; another name would never find its runs.
    names = {figure.method for figure in read_figures(lambda *_: True)}
    assert {name: get_method(name).spec for name in names} == {name: name for name in names}


def test_each_column_tells_its_seeds(tmp_path: Path, make_record: MakeRecord) -> None:
    for seed in range(3):
        make_record(tmp_path, method="sac", seed=seed, **FULL)
    make_record(tmp_path, method="dd-rq", **FULL)
    drawn = _drawn(tmp_path)
    assert "for each of 1 to 3 seeds" in drawn["ablation.md"]
    assert "| Seeds |  | here | 1 |  |  |  |  | 3 |\n" in drawn["ablation.md"]
    assert "Seeds &  & here & 1 &  &  &  &  & 3 \\\\" in drawn["ablation.tex"]


def test_dd_rq_plus_has_columns_where_it_was_run_or_tried(
    tmp_path: Path, make_record: MakeRecord, make_spec: Make
) -> None:
    make_record(tmp_path, method="sac", **FULL)
    assert "DD-RQ-plus" not in _drawn(tmp_path)["ablation.md"]
    make_record(tmp_path, method="dd-rq-plus", **FULL)
    Store(tmp_path).fail(make_spec(method="dd-rq-plus", scenario="b", **FULL), Failure("train", 5, "tripped"))
    drawn = _drawn(tmp_path)
    assert _cells(drawn["ablation.csv"])["collision_rate", "DD-RQ-plus", "A"]["value"] == "0"
    published, own = drawn["ablation.md"].split("Not in the paper:")
    assert "| paper | 0 % | 0 % | 2 % | 3 % | 0 % | 49.7 % |" in published
    assert "| Ours | Tc=1.0 | Tc=3.0 | Tc=5.0 | Tc=7.0 | SAC |" in published
    assert "| mean Tc | shuffled RQ | DD-RQ-plus |" in own
    assert "paper" not in own.partition("[1]")[0]
    reason = _cells(drawn["collision.csv"])["collision_rate", "DD-RQ-plus", "A"]["reason"]
    assert reason == "seed 0 failed at step 5 (train): tripped"


def test_a_method_is_compared_with_its_controls(standard_results: Path) -> None:
    # By construction 0.6 m/s faster than with the constant mean, and the same as with shuffled RQ.
    remarks = tables.build("ablation", collect(standard_results)).remarks
    assert [remark.partition(":")[0] for remark in remarks] == ["dd-rq minus its control dd-rq"] * 2
    assert "control dd-rq:tc=mean: speed T +0.60 m/s" in remarks[0]
    assert remarks[0].endswith("better in speed T and speed A.")
    assert remarks[1].endswith("neither better nor worse as far as these seeds can show.")


def test_a_control_with_a_single_seed_says_nothing(tmp_path: Path, make_record: MakeRecord) -> None:
    for method in ("dd-rq", "dd-rq:tc=mean"):
        make_record(tmp_path, method=method, **FULL)
    assert tables.build("ablation", collect(tmp_path)).remarks == ()


def test_a_method_may_be_worse_than_its_control(tmp_path: Path, make_record: MakeRecord) -> None:
    for seed in range(3):
        make_record(tmp_path, method="dd-rq", seed=seed, look={"speed_mps": 11.0, "flagged": 0.06}, **FULL)
        make_record(tmp_path, method="dd-rq:tc=mean", seed=seed, look={"speed_mps": 12.0, "flagged": 0.02}, **FULL)
    (remark,) = tables.build("ablation", collect(tmp_path)).remarks
    assert remark.endswith(": worse in speed T and interventions T and speed A and interventions A.")

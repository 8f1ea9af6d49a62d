"""Figures: what records allow is drawn, what they lack is left out, the same records give the same bytes."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from bench import plots
from bench.plots import spacetime, style, sweep
from bench.plots.data import pick, runs
from bench.records import collect, read_record
from bench.statistics import mean_interval
from tests.bench.policy_records import reference_policy, write_record

MakeRecord = Callable[..., Path]
ALL = [
    "interventions", "learning-a", "learning-b", "least-ttc", "pareto-a", "pareto-b", "profiles", "space-time-a",
    "tc-sweep-a",
]  # fmt: skip
FULL = {"steps": 500_000, "eval_episodes": 100}


@pytest.fixture
def cruising(monkeypatch: pytest.MonkeyPatch) -> None:
    """Episodes are drawn of the scripted driver, which needs no weights."""
    monkeypatch.setattr(spacetime, "DRIVERS", ("cruise+guard",))


def test_every_figure_is_drawn_as_pdf_and_png_and_a_second_time_with_the_same_bytes(
    standard_results: Path, tmp_path: Path, cruising: None
) -> None:
    shutil.copytree(standard_results, tmp_path / "results")
    write_record(tmp_path / "results", "cruise+guard", reference_policy("cruise+guard"))
    collection = collect(tmp_path / "results")
    paths = plots.write(collection, tmp_path / "1")
    assert sorted(path.name for path in paths) == sorted(f"{n}.{suffix}" for n in ALL for suffix in ("pdf", "png"))
    for path in paths:
        head = path.read_bytes()[:8]
        assert head.startswith(b"%PDF") if path.suffix == ".pdf" else head == b"\x89PNG\r\n\x1a\n"
        assert path.stat().st_size < 500_000
    with style.styled():
        found = runs(collection, "a")
        again = style.save(sweep.draw("a", found), tmp_path / "2", "tc-sweep-a")
    for path in again:
        assert path.read_bytes() == (tmp_path / "1" / path.name).read_bytes(), path.name


@pytest.fixture
def unsaved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made but not rendered: saving is what takes time."""
    monkeypatch.setattr(style, "save", lambda _figure, folder, name: [folder / name])


def test_what_has_no_runs_is_not_drawn(tmp_path: Path, make_record: MakeRecord, unsaved: None) -> None:
    assert plots.write(collect(tmp_path / "nothing"), tmp_path / "plots") == []
    make_record(tmp_path, method="sac", look={"flagged": 0.0}, **FULL)
    names = {path.name for path in plots.write(collect(tmp_path), tmp_path / "plots")}
    assert names == {"learning-a", "pareto-a", "profiles", "least-ttc"}


def test_figures_show_the_runs_of_the_tables_and_the_drivers(tmp_path: Path, make_record: MakeRecord) -> None:
    for seed in range(2):
        make_record(tmp_path, method="sac", seed=seed, **FULL)
    make_record(tmp_path, method="dd-rq", steps=100_000, eval_episodes=100)
    make_record(tmp_path, method="sac", seed=5, cost_limit=0.1, **FULL)
    for episodes in (20, 40):
        make_record(tmp_path, method="idm", steps=0, eval_episodes=episodes)
    found = runs(collect(tmp_path), "a")
    assert [(entry.method, len(entry.records)) for entry in found] == [("sac", 2), ("idm", 1)]
    assert found[1].records[0].spec.eval_episodes == 40
    assert pick(found, ["idm", "cpo"]) == [found[1]]
    speed, interval = found[0].mean("A", lambda c: c.speed_mps)
    assert speed == pytest.approx(12.0, rel=1e-4)
    assert interval == mean_interval([c.speed_mps for c in found[0].counts("A")]).interval
    assert found[1].mean("T", lambda c: c.speed_mps)[1].empty


def test_the_drawn_episode_is_chosen_by_a_rule(tmp_path: Path, make_record: MakeRecord, monkeypatch) -> None:
    record = read_record(make_record(tmp_path, look={"flagged": 0.1}))
    assert spacetime.choose_episode(record) == 0, "no episode changes lanes"
    whole = type(record).eval_episodes

    def with_lane_changes(own: object) -> object:
        table = whole(own)
        at = table.column_names.index("lane_changes")
        changes = np.where(np.arange(len(table)) >= 7, 2, 1).astype(np.int16)
        return table.set_column(at, table.schema.field(at), [changes])

    monkeypatch.setattr(type(record), "eval_episodes", with_lane_changes)
    assert spacetime.choose_episode(record) == 7


def test_an_episode_that_comes_out_otherwise_is_not_drawn_and_it_is_said_why(
    tmp_path: Path, cruising: None, unsaved: None
) -> None:
    policy = reference_policy("cruise+guard")
    write_record(tmp_path, "cruise+guard", policy, change={(k, "jerk_sum"): 1e6 for k in range(12)})
    said: list[str] = []
    names = {path.name for path in plots.write(collect(tmp_path), tmp_path / "plots", said.append)}
    assert "space-time-a" not in names
    assert "pareto-a" in names
    assert said[0].startswith("space-time-a is not drawn: ")


def test_a_record_whose_policy_was_not_kept_gives_no_episode(tmp_path: Path, make_record: MakeRecord) -> None:
    shutil.rmtree(make_record(tmp_path, method="safety-guard", method_version=1, **FULL) / "policy")
    assert spacetime.draw("a", runs(collect(tmp_path), "a")) is None


def test_methods_of_one_figure_are_told_apart_without_colour() -> None:
    looks = [style.LOOKS[method] for method in style.CORE]
    greys = [round(sum(w * c for w, c in zip((0.299, 0.587, 0.114), to_rgb(k.colour), strict=True)), 2) for k in looks]
    assert len({(look.line, grey) for look, grey in zip(looks, greys, strict=True)}) == len(looks)
    assert len({look.marker for look in style.LOOKS.values()}) == len(style.LOOKS)
    assert len({look.label for look in style.LOOKS.values()}) == len(style.LOOKS)


def test_an_unknown_method_has_a_look_that_stays() -> None:
    assert style.look("my-method") == style.look("my-method")
    assert style.order("my-method") > style.order("random+guard")

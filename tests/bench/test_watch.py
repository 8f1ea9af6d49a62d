"""An episode in the terminal says the same with and without colour, and ends with Ctrl-C."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from bench.replay import watch
from bench.replay.held_out import Replay
from bench.replay.shield_watch import GuardView
from envs.layout import EpisodeSource
from envs.scenario import get_scenario
from envs.trace import record_episode

WIDTH = 100


@pytest.fixture(scope="module")
def shown() -> Replay:
    source = EpisodeSource(get_scenario("b"), np.random.SeedSequence(3))
    trace = record_episode(source, 0, lambda _: np.array([[0.0, 0.5]]))
    steps, bodies = len(trace), trace.vehicles.shape[1] + trace.pedestrians.shape[1]
    importance = np.zeros((steps, bodies))
    importance[:, np.argmin(trace.vehicles["s"][0])] = 0.75
    full = np.full(steps, 1.0)
    return Replay("somebody", trace, GuardView(2.5 * full, 40.0 * full, full, full, -full, importance))


def test_the_ego_is_a_quarter_of_the_way_in_its_lanes_row(shown: Replay) -> None:
    rows = watch.road(shown, 0, WIDTH)
    assert {len(row) for row in rows[:-1]} == {WIDTH}
    (row,) = [k for k, text in enumerate(rows) if "[EEE>" in text]
    assert row == watch.MIDDLE - round(shown.trace.ego["d"][0] / watch.ROW_M)
    assert abs(rows[row].index("[EEE>") + 2.5 - watch.BEHIND * WIDTH) <= 1.0
    assert rows[1] == rows[-3] == "=" * WIDTH


def test_a_car_stands_as_many_characters_ahead_as_metres(shown: Replay) -> None:
    rows = watch.road(shown, 0, 220)
    cars, ego = shown.trace.vehicles[0], shown.trace.ego[0]
    car = cars[np.argmin(cars["s"])]
    text = rows[watch.MIDDLE - round(car["d"] / watch.ROW_M)]
    # The guard ranks the nearest one, so its importance stands in it.
    own = next(row for row in rows if "[EEE>" in row).index("[EEE>")
    assert abs(text.index("[ 75>") - own - (car["s"] - ego["s"])) <= 1.0


def test_status_names_risk_and_the_end(shown: Replay) -> None:
    assert any("RQ [########............]  40 %" in line for line in watch.status(shown, 3))
    assert watch.status(shown, 3)[-1] == ""
    assert watch.status(shown, len(shown.trace))[-1].startswith("ended: ")


def test_without_a_terminal_there_is_no_control_code_and_no_waiting(
    shown: Replay, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch.time, "sleep", lambda _: pytest.fail("it waits"))
    file = io.StringIO()
    watch.watch([shown], Console(file=file, width=WIDTH))
    assert "\x1b" not in file.getvalue()
    assert file.getvalue().count("somebody, episode 0") == len(range(0, len(shown.trace), watch.PLAIN_EVERY)) + 1


def test_colour_only_repeats_what_the_characters_say(shown: Replay) -> None:
    text = watch.frame(shown, 5, WIDTH)
    assert text.spans
    for row in watch.road(shown, 5, WIDTH):
        assert row in text.plain


def test_ctrl_c_ends_it_and_gives_the_terminal_back(shown: Replay, monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float] = []

    def wait(seconds: float) -> None:
        waits.append(seconds)
        if len(waits) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(watch.time, "sleep", wait)
    file = io.StringIO()
    console = Console(file=file, width=WIDTH, force_terminal=True)
    watch.watch([shown], console)
    assert len(waits) == 3
    assert file.getvalue().rstrip().endswith("\x1b[?25h")  # the cursor is shown again


def test_watch_on_the_command_line(tmp_path: Path, bench: Any) -> None:
    from tests.bench.policy_records import reference_policy, write_record

    write_record(tmp_path, "constant-speed", reference_policy("constant-speed"), episodes=2)
    result = bench("watch", "constant", "--episode", "1", "--results", tmp_path)
    assert result.exit_code == 0, result.output
    assert "constant-speed on a-v1, seed 0, episode 1" in result.stdout
    assert bench("watch", "nobody", "--results", tmp_path).exit_code == 2

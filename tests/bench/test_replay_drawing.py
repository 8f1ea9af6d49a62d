"""Replays as pictures, as packed numbers and as a page."""

import base64
import json
import zlib
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pytest

from bench.replay import draw, packed, page
from bench.replay.held_out import Replay
from bench.replay.shield_watch import GuardView
from envs.layout import EpisodeSource
from envs.rendering import HEIGHT_PX, WIDTH_PX
from envs.scenario import get_scenario
from envs.trace import EpisodeTrace, record_episode


def driven(acceleration: float) -> EpisodeTrace:
    source = EpisodeSource(get_scenario("b"), np.random.SeedSequence(3))
    return record_episode(source, 0, lambda _: np.array([[0.0, acceleration]]))


@pytest.fixture(scope="module")
def shown() -> Replay:
    trace = driven(2.0)
    steps, bodies = len(trace), trace.vehicles.shape[1] + trace.pedestrians.shape[1]
    importance = np.zeros((steps, bodies))
    importance[:, 1], importance[:, 2] = 0.75, 0.25
    limits = np.full(steps, np.inf)
    full = np.ones(steps)
    return Replay(
        "</script>somebody", trace, GuardView(2.5 * full, 43.0 * full, full, limits, -limits, importance), False
    )


def unpacked(series: list[int], scale: float) -> np.ndarray:
    return np.cumsum(np.cumsum(series)) / scale


def test_packed_positions_are_right_to_half_a_centimetre(shown: Replay) -> None:
    content = packed.packed(shown)
    trace = shown.trace
    np.testing.assert_allclose(unpacked(content["ego"]["s"], 100.0), trace.ego["s"], atol=0.00501)
    np.testing.assert_allclose(unpacked(content["cars"][2]["d"], 100.0), trace.vehicles["d"][:, 2], atol=0.00501)
    np.testing.assert_array_equal(unpacked(content["people"][0]["state"], 1.0), trace.pedestrians["state"][:, 0])
    np.testing.assert_array_equal(unpacked(content["guard"]["risk"], 1.0), 43.0)
    np.testing.assert_allclose(unpacked(content["guard"]["importance"][1], 100.0), 0.75)
    np.testing.assert_allclose(unpacked(content["guard"]["ahead"], 100.0), packed.LIMIT_MPS2)
    assert content["exact"] is False
    assert len(content["intervened"]) == content["steps"] == len(trace)


def test_packed_text_is_deflated_json_and_small(shown: Replay) -> None:
    text = packed.packed_text([shown])
    assert json.loads(zlib.decompress(base64.b64decode(text))) == [packed.packed(shown)]
    assert len(text) < 6_000


def test_importance_goes_from_green_to_red() -> None:
    assert draw.importance_colour(0.0, 0.4) == draw.CALM
    assert draw.importance_colour(0.4, 0.4) == draw.URGENT
    assert draw.importance_colour(0.0, 0.0) == draw.CALM
    middle = draw.importance_colour(0.2, 0.4)
    assert draw.CALM[0] < middle[0] < draw.URGENT[0]


def test_bodies_carry_importance_and_the_text_says_what_the_guard_knew(shown: Replay) -> None:
    noted = draw.annotation(shown, 4)
    assert list(noted.vehicle_labels[:3]) == [None, "75 %", "25 %"]
    assert noted.vehicle_colours[1] == draw.URGENT
    assert noted.vehicle_colours[0] is None
    assert noted.lines[0].endswith("episode 0, to rounding")
    assert noted.lines[1] == "T_c 2.50 s, RQ 43 %"


def test_a_sheet_shows_the_closest_call_and_two_methods_beside_each_other(shown: Replay, tmp_path: Path) -> None:
    other = Replay("nobody", driven(-1.0), None)
    sheet = draw.sheet([shown, other])
    assert sheet.shape == (draw.MOMENTS * HEIGHT_PX, 2 * WIDTH_PX, 3)
    closest = draw.picture(shown, draw.closest_step(shown))
    assert any((sheet[k * HEIGHT_PX : (k + 1) * HEIGHT_PX, :WIDTH_PX] == closest).all() for k in range(draw.MOMENTS))
    draw.write_picture([shown], tmp_path / "x.png")
    assert imageio.imread(tmp_path / "x.png").shape == (draw.MOMENTS * HEIGHT_PX, WIDTH_PX, 3)


def test_of_two_episodes_the_shorter_one_waits_for_the_other(shown: Replay) -> None:
    other = Replay("nobody", driven(-1.0), None)
    lengths = sorted([len(shown.trace), len(other.trace)])
    assert lengths[0] < lengths[1]
    pictures = list(draw.pictures([shown, other], every=lengths[1]))
    assert [picture.shape for picture in pictures] == [(2 * HEIGHT_PX, WIDTH_PX, 3)] * 2
    assert (pictures[-1][:HEIGHT_PX] == draw.picture(shown, len(shown.trace))).all()


def test_a_page_holds_its_episode_and_no_text_of_it_is_code(shown: Replay, tmp_path: Path) -> None:
    page.write_page([shown], tmp_path / "x.html")
    text = (tmp_path / "x.html").read_text(encoding="utf-8")
    assert text.count("</script>") == 2
    data = text.partition('id="data">')[2].partition("</script>")[0]
    assert json.loads(data)["replays"] == [json.loads(json.dumps(packed.packed(shown)))]


def test_a_part_that_looks_like_a_place_is_not_filled_again() -> None:
    assert page.fill("{{a}} {{b}}", {"a": "{{b}}", "b": "x"}) == "{{b}} x"
    with pytest.raises(KeyError):
        page.fill("{{c}}", {})

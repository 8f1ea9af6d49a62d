"""Frames show the road, the ego and everybody else where they are."""

import subprocess
import sys
from pathlib import Path

import imageio.v2 as imageio
import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from envs.layout import EpisodeSource
from envs.rendering import (
    CRASHED_COLOUR,
    EGO_COLOUR,
    HEIGHT_PX,
    PEDESTRIAN_COLOUR,
    PIXELS_PER_M,
    VEHICLE_COLOUR,
    VERGE_COLOUR,
    WAITING_COLOUR,
    WIDTH_PX,
    Annotation,
    frames,
    render_episode,
    render_world,
)
from envs.scenario import get_scenario
from envs.single_env import DrivingEnv
from envs.trace import EpisodeTrace, record_episode
from envs.world import CROSSING, WAITING, Ending, World, empty_world

ROAD_GREY = (100, 100, 100)
SCENARIO = get_scenario("b")


@pytest.fixture
def world() -> World:
    """The ego in the middle lane at s = 300 m, one car 20 m ahead in the left lane, nobody else."""
    world = empty_world(1, SCENARIO.vehicles, SCENARIO.pedestrians)
    world.ego["s"], world.ego["speed"] = 300.0, 10.0
    world.vehicles[0, 2]["present"], world.vehicles[0, 2]["s"], world.vehicles[0, 2]["d"] = 1, 320.0, 3.5
    world.pedestrians["state"] = 2
    return world


@pytest.fixture(scope="module")
def trace() -> EpisodeTrace:
    source = EpisodeSource(SCENARIO, np.random.SeedSequence(1))
    return record_episode(source, 3, lambda _: np.array([[0.0, 2.0]]))


def place(frame: np.ndarray, colour: tuple[int, int, int], tolerance: int = 25) -> tuple[float, float, int]:
    """Mean position of a colour, s and d relative to the picture's centre [m], and its number of pixels."""
    rows, columns = np.nonzero((np.abs(frame.astype(int) - colour) <= tolerance).all(axis=-1))
    assert rows.size, f"no pixel of colour {colour}"
    s = (columns.mean() + 0.5 - WIDTH_PX / 2) / PIXELS_PER_M
    return s, (HEIGHT_PX / 2 - rows.mean() - 0.5) / PIXELS_PER_M, rows.size


def shows(frame: np.ndarray, colour: tuple[int, int, int], tolerance: int = 25) -> bool:
    return bool((np.abs(frame.astype(int) - colour) <= tolerance).all(axis=-1).any())


def test_a_frame_is_an_rgb_array_and_not_blank(world: World) -> None:
    frame = render_world(SCENARIO, world, 0)
    assert frame.shape == (HEIGHT_PX, WIDTH_PX, 3)
    assert frame.dtype == np.uint8
    assert len(np.unique(frame.reshape(-1, 3), axis=0)) > 20


def test_the_road_is_grey_between_green_verges(world: World) -> None:
    frame = render_world(SCENARIO, world, 0)
    column = WIDTH_PX // 4
    for d in (-3.5, 0.0, 3.5):
        assert tuple(frame[round(HEIGHT_PX / 2 - d * PIXELS_PER_M), column]) == ROAD_GREY
    for d in (-7.0, 7.0):
        assert tuple(frame[round(HEIGHT_PX / 2 - d * PIXELS_PER_M), column]) == VERGE_COLOUR


def test_lane_markings_are_white_dashes_and_solid_edges(world: World) -> None:
    frame = render_world(SCENARIO, world, 0)
    for d, least, most in ((-5.25, 0.99, 1.0), (5.25, 0.99, 1.0), (-1.75, 0.5, 0.85), (1.75, 0.5, 0.85)):
        row = round(HEIGHT_PX / 2 - d * PIXELS_PER_M)
        white = (frame[row - 2 : row + 3] > 200).all(axis=-1).any(axis=0).mean()
        assert least <= white <= most


def test_the_ego_is_in_the_middle_and_has_its_size(world: World) -> None:
    s, d, pixels = place(render_world(SCENARIO, world, 0), EGO_COLOUR)
    assert (s, d) == pytest.approx((0.0, 0.0), abs=0.4)
    # 10 m2 without the lights and the dark outline.
    assert pixels / PIXELS_PER_M**2 == pytest.approx(8.0, rel=0.1)


@pytest.mark.parametrize("d", [-3.5, 3.5])
def test_a_vehicle_is_drawn_where_it_is_with_d_upwards(world: World, d: float) -> None:
    world.vehicles[0, 2]["d"] = d
    assert place(render_world(SCENARIO, world, 0), VEHICLE_COLOUR)[:2] == pytest.approx((20.0, d), abs=0.4)


def test_a_positive_heading_points_up(world: World) -> None:
    world.ego["heading"] = 0.3
    frame = render_world(SCENARIO, world, 0)
    ahead = (HEIGHT_PX // 2 - round(2 * np.sin(0.3) * PIXELS_PER_M), WIDTH_PX // 2 + round(2 * PIXELS_PER_M))
    assert np.abs(frame[ahead].astype(int) - EGO_COLOUR).max() < 25
    mirrored = (HEIGHT_PX - ahead[0] + round(0.6 * PIXELS_PER_M), ahead[1])
    assert tuple(frame[mirrored]) == ROAD_GREY


def test_absent_vehicles_and_gone_pedestrians_are_not_drawn(world: World) -> None:
    world.vehicles["present"] = 0
    frame = render_world(SCENARIO, world, 0)
    assert not any(shows(frame, colour) for colour in (VEHICLE_COLOUR, PEDESTRIAN_COLOUR, WAITING_COLOUR))


def test_a_crossing_pedestrian_is_visible_where_it_is(world: World) -> None:
    world.pedestrians[0, 1] = (CROSSING, 310.0, -2.0, 1.0, 50.0)
    s, d, pixels = place(render_world(SCENARIO, world, 0), PEDESTRIAN_COLOUR)
    assert (s, d) == pytest.approx((10.0, -2.0), abs=0.3)
    assert pixels > 60


def test_a_waiting_pedestrian_stands_at_the_kerb(world: World) -> None:
    world.pedestrians[0, 1] = (WAITING, 310.0, 5.75, -1.0, 50.0)
    frame = render_world(SCENARIO, world, 0)
    assert place(frame, WAITING_COLOUR, tolerance=8)[:2] == pytest.approx((10.0, 5.75), abs=0.4)
    assert not shows(frame, PEDESTRIAN_COLOUR)


def test_a_crashed_ego_is_red(world: World) -> None:
    world.episode["ending"] = Ending.COLLISION
    frame = render_world(SCENARIO, world, 0)
    assert place(frame, CRASHED_COLOUR)[:2] == pytest.approx((0.0, 0.0), abs=0.4)
    assert not shows(frame, EGO_COLOUR)


def test_the_text_tells_the_speed(world: World) -> None:
    before = render_world(SCENARIO, world, 0)
    world.ego["speed"] = 11.0
    changed = (before != render_world(SCENARIO, world, 0)).any(axis=-1)
    rows, columns = np.nonzero(changed)
    assert rows.max() < 30
    assert 330 < columns.min() <= columns.max() < 470


def test_annotations_colour_and_label_bodies(world: World) -> None:
    world.pedestrians[0, 0] = (CROSSING, 310.0, -2.0, 1.0, 50.0)
    plain = render_world(SCENARIO, world, 0)
    marked = render_world(
        SCENARIO,
        world,
        0,
        Annotation(
            vehicle_colours=(None, None, (200, 0, 0)),
            vehicle_labels=(None, None, "0.8"),
            pedestrian_colours=((0, 0, 250),),
            pedestrian_labels=("0.2",),
            lines=("RQ 63 %",),
        ),
    )
    assert place(marked, (200, 0, 0))[:2] == pytest.approx((20.0, 3.5), abs=0.4)
    assert place(marked, (0, 0, 250))[:2] == pytest.approx((10.0, -2.0), abs=0.3)
    rows, columns = np.nonzero((plain != marked).any(axis=-1))
    assert ((rows > HEIGHT_PX - 60) & (columns < 100)).any()
    above_the_car = (rows < HEIGHT_PX / 2 - 4.6 * PIXELS_PER_M) & (rows > 40)
    assert columns[above_the_car].mean() == pytest.approx(WIDTH_PX / 2 + 20 * PIXELS_PER_M, abs=8)


def test_rendering_does_not_change_the_world(world: World) -> None:
    before = world.copy()
    render_world(SCENARIO, world, 0)
    for name in ("ego", "vehicles", "pedestrians", "episode"):
        assert (getattr(world, name) == getattr(before, name)).all()


def test_frames_of_an_episode_end_with_its_last_state(trace: EpisodeTrace) -> None:
    every = 60
    pictures = list(frames(trace, every))
    assert len(pictures) == len(range(0, len(trace), every)) + 1
    assert (pictures[-1] == render_world(SCENARIO, trace.world(-1), 0)).all()
    assert shows(pictures[0], EGO_COLOUR)


def test_an_episode_becomes_png_frames(trace: EpisodeTrace, tmp_path: Path) -> None:
    count = render_episode(trace, tmp_path / "frames", every=80)
    files = sorted((tmp_path / "frames").iterdir())
    assert [file.name for file in files] == [f"frame_{k:04d}.png" for k in range(count)]
    assert (imageio.imread(files[0]) == render_world(SCENARIO, trace.world(0), 0)).all()


def read_film(path: Path) -> np.ndarray:
    """All frames of a film, by ffmpeg itself: imageio's reader leaves its pipes open at the end of a file."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", path, "-fps_mode", "passthrough"]
    raw = subprocess.run([*command, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], capture_output=True, check=True)
    return np.frombuffer(raw.stdout, np.uint8).reshape(-1, HEIGHT_PX, WIDTH_PX, 3)


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_an_episode_becomes_a_film_of_the_same_pictures(trace: EpisodeTrace, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"episode{suffix}"
    every = 40
    count = render_episode(trace, path, every=every)
    film = read_film(path)
    assert len(film) == count == len(range(0, len(trace), every)) + 1
    for picture, step in ((film[0], 0), (film[1], every), (film[-1], len(trace))):
        expected = render_world(SCENARIO, trace.world(step), 0).astype(int)
        assert np.abs(expected - picture).mean() < 6.0


def test_films_run_in_real_time(trace: EpisodeTrace, tmp_path: Path) -> None:
    for suffix in (".mp4", ".gif"):
        count = render_episode(trace, tmp_path / f"episode{suffix}", every=20)
    frames_found, seconds = imageio_ffmpeg.count_frames_and_secs(tmp_path / "episode.mp4")
    assert frames_found == count
    assert seconds == pytest.approx(2.0 * count, abs=0.1)
    with Image.open(tmp_path / "episode.gif") as image:
        assert image.info["duration"] == 2000


@pytest.mark.parametrize(("name", "every"), [("film.avi", 1), ("film.mp4", 0)])
def test_unknown_formats_and_steps_are_refused(trace: EpisodeTrace, tmp_path: Path, name: str, every: int) -> None:
    with pytest.raises(ValueError, match=rf"every = {every}, path = {name}"):
        render_episode(trace, tmp_path / name, every=every)


def test_the_environment_renders_its_world() -> None:
    env = DrivingEnv("a", render_mode="rgb_array")
    env.reset(seed=1)
    frame = env.render()
    assert frame.shape == (HEIGHT_PX, WIDTH_PX, 3)
    assert shows(frame, EGO_COLOUR)


def test_importing_the_renderer_prints_nothing() -> None:
    code = "import os; os.environ.pop('PYGAME_HIDE_SUPPORT_PROMPT', None); import envs.rendering"
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, check=True, text=True)
    assert done.stdout == ""

"""Pictures and films of worlds, drawn headless with highway-env's graphics."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import imageio.v2 as imageio
import numpy as np
import numpy.typing as npt

# highway_env comes before pygame: it silences pygame's greeting on standard output.
from highway_env.road.graphics import RoadGraphics, WorldSurface
from highway_env.road.road import Road
from highway_env.vehicle.graphics import VehicleGraphics
from highway_env.vehicle.kinematics import Vehicle
from pygame import Rect, Surface, draw, font, surfarray, transform

from envs.geometry import PEDESTRIAN_SIZE_M, ROAD_EDGE_M, VEHICLE_WIDTH_M, nearest_lane
from envs.highway_road import three_lane_network
from envs.scenario import GOAL_M, STEP_S, Scenario
from envs.trace import EpisodeTrace
from envs.world import CROSSING, GONE, Ending, World

Colour = tuple[int, int, int]
Frame = npt.NDArray[np.uint8]

WIDTH_PX: Final = 1280
HEIGHT_PX: Final = 256
VIEW_M: Final = 120.0
PIXELS_PER_M: Final = WIDTH_PX / VIEW_M
FRAMES_PER_S: Final = round(1 / STEP_S)
MARK_EVERY_M: Final = 20
SUPERSAMPLING: Final = 2
"""Bodies and lines are drawn this many times larger, then shrunk smoothly."""

EGO_COLOUR: Final[Colour] = (50, 200, 0)
CRASHED_COLOUR: Final[Colour] = (230, 50, 50)
VEHICLE_COLOUR: Final[Colour] = (100, 200, 255)
PEDESTRIAN_COLOUR: Final[Colour] = (255, 170, 0)
WAITING_COLOUR: Final[Colour] = (205, 190, 110)
VERGE_COLOUR: Final[Colour] = (62, 82, 58)
TEXT_COLOUR: Final[Colour] = (255, 255, 255)
SHADE_COLOUR: Final[Colour] = (25, 30, 25)
LANE_NAMES: Final = ("right", "middle", "left")


@dataclass(frozen=True, slots=True)
class Annotation:
    """What is drawn over a world; sequences go by column, None keeps the usual look, short ones are padded.

    Attributes:
        vehicle_colours: Fill of each vehicle, shape (V,).
        vehicle_labels: Text over each vehicle, shape (V,).
        pedestrian_colours: Fill of each pedestrian, shape (P,).
        pedestrian_labels: Text over each pedestrian, shape (P,).
        lines: Text at the lower left, one string a line.
    """

    vehicle_colours: Sequence[Colour | None] = ()
    vehicle_labels: Sequence[str | None] = ()
    pedestrian_colours: Sequence[Colour | None] = ()
    pedestrian_labels: Sequence[str | None] = ()
    lines: Sequence[str] = ()


PLAIN: Final = Annotation()
Annotate = Callable[[EpisodeTrace, int], Annotation]


@functools.cache
def _font(size: int) -> font.Font:
    font.init()
    return font.Font(None, size)


@functools.cache
def _road() -> Road:
    """The empty road with d to the left of travel drawn upwards: y is -d."""
    return Road(three_lane_network(up=-1.0), np_random=np.random.RandomState(0))


def _pick(values: Sequence[Colour | None], j: int, default: Colour) -> Colour:
    return (values[j] if j < len(values) else None) or default


def _draw_road(surface: WorldSurface) -> None:
    RoadGraphics.display(_road(), surface)
    width, height = surface.get_size()
    top = surface.pos2pix(0.0, -ROAD_EDGE_M - 0.3)[1]
    bottom = surface.pos2pix(0.0, ROAD_EDGE_M + 0.3)[1]
    draw.rect(surface, VERGE_COLOUR, Rect(0, 0, width, top))
    draw.rect(surface, VERGE_COLOUR, Rect(0, bottom, width, height - bottom))
    goal = [surface.pos2pix(GOAL_M, y) for y in (-ROAD_EDGE_M, ROAD_EDGE_M)]
    draw.line(surface, TEXT_COLOUR, goal[0], goal[1], surface.pix(0.6))


class _Car(Vehicle):  # type: ignore[misc]
    """A car without wheels: highway-env lets a plain `Vehicle`'s stick out of the body that collides."""


def _draw_car(surface: WorldSurface, s: float, d: float, heading: float, colour: Colour) -> None:
    car = _Car(None, [s, -d], -heading)
    car.color = colour
    VehicleGraphics.display(car, surface, offscreen=True)


def _draw_pedestrian(surface: WorldSurface, s: float, d: float, crossing: bool, colour: Colour) -> None:
    x, y = surface.pos2pix(s, -d)
    side = surface.pix(PEDESTRIAN_SIZE_M)
    draw.rect(surface, colour if crossing else WAITING_COLOUR, Rect(x - side // 2, y - side // 2, side, side))
    if crossing:
        draw.circle(surface, colour, (x, y), surface.pix(1.1), width=surface.pix(0.2))


def _draw_bodies(surface: WorldSurface, world: World, row: int, annotation: Annotation) -> None:
    for j, p in enumerate(world.pedestrians[row]):
        if p["state"] != GONE:
            colour = _pick(annotation.pedestrian_colours, j, PEDESTRIAN_COLOUR)
            _draw_pedestrian(surface, p["s"], p["d"], p["state"] == CROSSING, colour)
    for j, v in enumerate(world.vehicles[row]):
        if v["present"]:
            colour = _pick(annotation.vehicle_colours, j, VEHICLE_COLOUR)
            _draw_car(surface, v["s"], v["d"], v["heading"], colour)
    ego = world.ego[row]
    crashed = world.episode["ending"][row] == Ending.COLLISION
    _draw_car(surface, ego["s"], ego["d"], ego["heading"], CRASHED_COLOUR if crashed else EGO_COLOUR)


def _write(picture: Surface, text: str, x: float, y: float, size: int = 18, centred: bool = False) -> None:
    words = _font(size).render(text, True, TEXT_COLOUR, SHADE_COLOUR)
    picture.blit(words, (x - words.get_width() / 2 if centred else x, y))


def _write_labels(picture: Surface, world: World, row: int, annotation: Annotation) -> None:
    centre = world.ego["s"][row]
    cars, people = world.vehicles[row], world.pedestrians[row]
    for bodies, labels, half_width, shown in (
        (cars, annotation.vehicle_labels, VEHICLE_WIDTH_M / 2, cars["present"] == 1),
        (people, annotation.pedestrian_labels, 1.1, people["state"] != GONE),
    ):
        for body, label, visible in zip(bodies, labels, shown, strict=False):
            if label and visible and abs(body["s"] - centre) < VIEW_M / 2:
                x = WIDTH_PX / 2 + (body["s"] - centre) * PIXELS_PER_M
                y = HEIGHT_PX / 2 - (body["d"] + half_width) * PIXELS_PER_M
                _write(picture, label, x, y - 13, centred=True)


def _write_overlay(picture: Surface, scenario: Scenario, world: World, row: int, lines: Sequence[str]) -> None:
    ego, episode = world.ego[row], world.episode[row]
    steps, ending = int(episode["steps"]), Ending(episode["ending"])
    entries = (
        (10, f"t = {steps * STEP_S:.1f} s"),
        (115, f"step {steps}"),
        (215, f"s = {ego['s']:.1f} m"),
        (335, f"v = {ego['speed']:.2f} m/s"),
        (475, f"a = {ego['acceleration']:+.2f} m/s²"),
        (625, f"target: {LANE_NAMES[nearest_lane(ego['target_d'])]} lane"),
        (825, "" if ending is Ending.RUNNING else f"ended: {ending.name.replace('_', '-').lower()}"),
    )
    for x, text in entries:
        _write(picture, text, x, 8, size=24)
    _write(picture, scenario.id, WIDTH_PX - 10 - _font(18).size(scenario.id)[0], HEIGHT_PX - 42)
    for k, line in enumerate(reversed(lines)):
        _write(picture, line, 10, HEIGHT_PX - 44 - 20 * k, size=22)
    first, last = ((ego["s"] + side * VIEW_M / 2) / MARK_EVERY_M for side in (-1, 1))
    for mark in range(math.ceil(first), math.floor(last) + 1):
        x = WIDTH_PX / 2 + (mark * MARK_EVERY_M - ego["s"]) * PIXELS_PER_M
        draw.line(picture, TEXT_COLOUR, (x, HEIGHT_PX - 22), (x, HEIGHT_PX - 17))
        _write(picture, f"{mark * MARK_EVERY_M} m", x, HEIGHT_PX - 15, centred=True)


def render_world(scenario: Scenario, world: World, row: int, annotation: Annotation = PLAIN) -> Frame:
    """One world as a picture: travel is to the right, d upwards, 120 m around the ego.

    Args:
        scenario: Named in the picture.
        world: N worlds; not changed.
        row: Which of them.
        annotation: Colours and texts over the bodies.

    Returns:
        RGB, shape (256, 1280, 3).
    """
    size = (WIDTH_PX * SUPERSAMPLING, HEIGHT_PX * SUPERSAMPLING)
    surface = WorldSurface(size, 0, Surface(size, depth=32))
    surface.scaling = PIXELS_PER_M * SUPERSAMPLING
    surface.move_display_window_to(np.array([world.ego["s"][row], 0.0]))
    _draw_road(surface)
    _draw_bodies(surface, world, row, annotation)
    picture = transform.smoothscale(surface, (WIDTH_PX, HEIGHT_PX))
    _write_labels(picture, world, row, annotation)
    _write_overlay(picture, scenario, world, row, annotation.lines)
    return np.ascontiguousarray(surfarray.array3d(picture).swapaxes(0, 1))


def note_interventions(trace: EpisodeTrace, step: int) -> Annotation:
    """Says what the shield changed in the step that led here, where it intervened."""
    if step == 0 or not trace.intervened[step - 1]:
        return PLAIN
    (asked_d, asked_a), (given_d, given_a) = trace.proposed[step - 1], trace.executed[step - 1]
    changes = f"d {asked_d:+.2f} -> {given_d:+.2f} m, a {asked_a:+.2f} -> {given_a:+.2f} m/s²"
    return Annotation(lines=[f"shield: {changes}"])


def frames(trace: EpisodeTrace, every: int = 1, annotate: Annotate = note_interventions) -> Iterator[Frame]:
    """Pictures of an episode, one for every so many steps of 0.1 s; the last state is always among them."""
    for step in [*range(0, len(trace), every), len(trace)]:
        yield render_world(trace.scenario, trace.world(step), 0, annotate(trace, step))


def render_episode(trace: EpisodeTrace, path: Path, *, every: int = 1, annotate: Annotate = note_interventions) -> int:
    """Write an episode in real time as a film, ``.mp4`` or ``.gif``, or as PNG frames into a folder.

    Args:
        trace: The episode.
        path: File with one of the two suffixes, or a folder, made if missing.
        every: Steps of 0.1 s from one frame to the next, at least 1.
        annotate: Called with the trace and the number of steps done, for what is drawn over that state.

    Returns:
        Number of frames.

    Raises:
        ValueError: The suffix is neither of the two, or ``every`` is below 1.
    """
    if every < 1 or path.suffix not in ("", ".mp4", ".gif"):
        raise ValueError(
            f"every = {every}, path = {path.name}: every must be 1 or more, the suffix .mp4, .gif or none."
        )
    pictures = frames(trace, every, annotate)
    if path.suffix:
        return write_film(pictures, path, FRAMES_PER_S / every)
    path.mkdir(parents=True, exist_ok=True)
    count = 0
    for picture in pictures:
        imageio.imwrite(path / f"frame_{count:04d}.png", picture)
        count += 1
    return count


def write_film(pictures: Iterable[Frame], path: Path, rate: float) -> int:
    """Write pictures of one size as a film.

    Args:
        pictures: RGB, both sides multiples of 16.
        path: File with the suffix ``.mp4`` or ``.gif``.
        rate: Pictures per second.

    Returns:
        Number of pictures.
    """
    if path.suffix == ".mp4":
        writer = imageio.get_writer(path, format="FFMPEG", mode="I", fps=rate, macro_block_size=16)
    else:
        writer = imageio.get_writer(path, format="GIF-PIL", mode="I", duration=1 / rate, loop=0)
    count = 0
    with writer:
        for picture in pictures:
            writer.append_data(picture)
            count += 1
    return count

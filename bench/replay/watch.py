"""An episode in the terminal: drawn with characters, readable without colour."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Final

from rich.console import Console
from rich.live import Live
from rich.text import Text

from bench.replay.held_out import Replay
from envs.geometry import VEHICLE_LENGTH_M
from envs.scenario import GOAL_M, LANE_WIDTH_M, STEP_S
from envs.world import CROSSING, WAITING, Ending

ROW_M: Final = LANE_WIDTH_M / 2
"""Height of a row: a car stands in a lane's row, or between two while it changes lane."""
ROWS: Final = 9
"""Kerb, edge, three lanes with two lines between them, edge, kerb."""
MIDDLE: Final = ROWS // 2
WIDTH_MIN: Final = 40
BEHIND: Final = 0.25
"""Share of the view behind the ego."""
MARK_EVERY_M: Final = 20
PLAIN_EVERY: Final = 50
"""Steps of 0.1 s from one picture to the next where there is no terminal."""
BAR: Final = 20
STYLES: Final = {"E": "bold green", "X": "bold red", "o": "cyan", "P": "bold yellow", "p": "yellow"}


def road(replay: Replay, step: int, width: int) -> list[str]:
    """The road from above, travel to the right, one character a metre.

    ``[EEE>`` is the ego, ``[XXX>`` after a crash, ``[ooo>`` another car (with the guard's importance in percent where
    it ranks), ``P`` a crossing pedestrian, ``p`` a waiting one.

    Args:
        replay: The episode.
        step: Steps done.
        width: Characters.

    Returns:
        Rows from left to right of travel, then marks of the position.
    """
    world = replay.trace.world(step)
    ego = world.ego[0]
    first = round(float(ego["s"]) - BEHIND * width)
    rows = [list(_background(k, first, width)) for k in range(ROWS)]

    def put(s: float, d: float, text: str) -> None:
        row = min(max(MIDDLE - round(d / ROW_M), 0), ROWS - 1)
        start = round(s - first - len(text) / 2)
        for k, character in enumerate(text):
            if 0 <= start + k < width:
                rows[row][start + k] = character

    importance = replay.guard.importance[max(step - 1, 0)] if replay.guard is not None and len(replay.trace) else None
    for j, car in enumerate(world.vehicles[0]):
        if car["present"]:
            put(
                car["s"],
                car["d"],
                _car("o" if importance is None or not importance[j] else f"{100 * importance[j]:.0f}"),
            )
    for person in world.pedestrians[0]:
        if person["state"] in (WAITING, CROSSING):
            put(person["s"], person["d"], "P" if person["state"] == CROSSING else "p")
    crashed = world.episode["ending"][0] in (Ending.COLLISION, Ending.OFF_ROAD)
    put(ego["s"], ego["d"], _car("X" if crashed else "E"))
    return ["".join(row) for row in rows] + [_marks(first, width)]


def _car(inside: str) -> str:
    """Five metres of car: its mark, or a number, between bumpers."""
    space = round(VEHICLE_LENGTH_M) - 2
    return f"[{inside * space if len(inside) == 1 and not inside.isdigit() else inside.center(space)}>"


def _background(row: int, first: int, width: int) -> str:
    away = abs(row - MIDDLE)
    if away == 3:
        return "=" * width
    line = ["-" if away == 1 and (first + k) % 9 < 3 else " " for k in range(width)]
    goal = round(GOAL_M) - first
    if away < 3 and 0 <= goal < width:
        line[goal] = "#"
    return "".join(line)


def _marks(first: int, width: int) -> str:
    line = [" "] * (width + 8)
    for mark in range(math.ceil(first / MARK_EVERY_M) * MARK_EVERY_M, first + width, MARK_EVERY_M):
        text = f"|{mark} m"
        line[mark - first : mark - first + len(text)] = text
    return "".join(line)[:width].rstrip()


def status(replay: Replay, step: int) -> list[str]:
    """What goes on, in words."""
    trace, guard = replay.trace, replay.guard
    ego, episode = trace.ego[step], trace.episode[step]
    place = f"t {STEP_S * step:5.1f} s   s {ego['s']:6.1f} m"
    lines = [
        f"{replay.title}, episode {trace.number}",
        f"{place}   v {ego['speed']:5.2f} m/s   a {ego['acceleration']:+5.2f} m/s2",
    ]
    at = max(step - 1, 0)
    if guard is not None and len(trace):
        risk = guard.risk_percent[at]
        shown = f"   RQ {_bar(risk)} {risk:3.0f} %" if math.isfinite(risk) else ""
        lines.append(f"T_c {guard.tc_s[at]:4.2f} s{shown}   flagged so far {episode['interventions']} of {step} steps")
    if step and trace.intervened[at]:
        (asked_d, asked_a), (given_d, given_a) = trace.proposed[at], trace.executed[at]
        asked = f"a {asked_a:+.2f}" if math.isfinite(asked_a) else "a plan"
        lines.append(f"GUARD: asked d {asked_d:+.2f} m, {asked}; given d {given_d:+.2f} m, a {given_a:+.2f} m/s2")
    else:
        lines.append("")
    ending = Ending(episode["ending"])
    lines.append("" if ending is Ending.RUNNING else f"ended: {ending.name.lower().replace('_', '-')}")
    return lines


def _bar(percent: float) -> str:
    filled = round(BAR * min(max(percent, 0.0), 100.0) / 100.0)
    return f"[{'#' * filled}{'.' * (BAR - filled)}]"


def frame(replay: Replay, step: int, width: int) -> Text:
    """Road and status as one text; colour only repeats what the characters say."""
    top, *rest = status(replay, step)
    text = Text(top + "\n", no_wrap=True)
    for row in road(replay, step, width):
        for character in row:
            text.append(character, STYLES.get(character))
        text.append("\n")
    text.append("\n".join(rest))
    return text


def watch(replays: Sequence[Replay], console: Console) -> None:
    """Play episodes in real time, one above the other, until they end or Ctrl-C.

    Where there is no terminal, one picture in five seconds of the episode is printed at once.
    """
    last = max(len(replay.trace) for replay in replays)
    width = max(console.width - 1, WIDTH_MIN)

    def picture(step: int) -> Text:
        return Text("\n\n").join(frame(replay, min(step, len(replay.trace)), width) for replay in replays)

    if not console.is_terminal:
        for step in [*range(0, last, PLAIN_EVERY), last]:
            console.print(picture(step), "", sep="\n", soft_wrap=True)
        return
    with Live(picture(0), console=console, auto_refresh=False) as live:
        begun = time.monotonic()
        try:
            for step in range(last + 1):
                time.sleep(max(0.0, begun + STEP_S * step - time.monotonic()))
                live.update(picture(step), refresh=True)
        except KeyboardInterrupt:
            return

"""Progress on the terminal: a live table, plain lines, or nothing. All on standard error."""

from __future__ import annotations

import sys
import time
from typing import Final, Self

import psutil
from rich.console import Console, Group
from rich.live import Live
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table
from rich.text import Text

from bench.progress import Board, Display, Phase, RunStatus, duration

LINE_EVERY_S: Final = 15.0
ROWS_MAX: Final = 24


class Silent:
    """Shows nothing but failures."""

    def __init__(self, board: Board) -> None:
        self.board = board

    def __enter__(self) -> Self:
        """Nothing to begin."""
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing to end."""

    def changed(self, run: RunStatus) -> None:
        """Report a failure."""
        if run.phase is Phase.FAILED:
            print(f"failed: {run.spec.label}: {run.reason}", file=sys.stderr, flush=True)

    def refresh(self) -> None:
        """Nothing to draw."""


class Lines(Silent):
    """Plain lines, for logs: each start and end, and now and then the progress of what runs."""

    def __init__(self, board: Board) -> None:
        super().__init__(board)
        self._last = time.monotonic()

    def changed(self, run: RunStatus) -> None:
        """Report the change."""
        tail = f" in {duration(run.seconds)}" if run.phase is Phase.DONE else ""
        tail += f": {run.reason}" if run.reason else ""
        phase = "started" if run.phase is Phase.RUNNING else str(run.phase)
        print(f"{phase}: {run.spec.label}{tail}", file=sys.stderr, flush=True)

    def refresh(self) -> None:
        """Report the progress of running runs, every 15 s."""
        if time.monotonic() - self._last < LINE_EVERY_S:
            return
        self._last = time.monotonic()
        for run in self.board.runs:
            if run.phase is Phase.RUNNING:
                print(f"{run.spec.label}: {', '.join(filter(None, cells(run)))}", file=sys.stderr)
        print(self.board.summary(), file=sys.stderr, flush=True)


class LiveTable(Silent):
    """A table of all runs that is redrawn in place."""

    def __init__(self, board: Board) -> None:
        super().__init__(board)
        self._live = Live(self._draw(), console=Console(stderr=True), transient=True, auto_refresh=False)
        self._drawn = 0.0

    def __enter__(self) -> Self:
        """Take over the terminal's lower part."""
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Give it back; the table vanishes, the results follow."""
        self._live.stop()

    def changed(self, run: RunStatus) -> None:
        """Redraw at once; a failure stays on the screen."""
        if run.phase is Phase.FAILED:
            self._live.console.print(f"failed: {run.spec.label}: {run.reason}", markup=False, highlight=False)
        self._live.update(self._draw(), refresh=True)

    def refresh(self) -> None:
        """Redraw, four times a second at most."""
        if time.monotonic() - self._drawn >= 0.25:
            self._drawn = time.monotonic()
            self._live.update(self._draw(), refresh=True)

    def _draw(self) -> Group:
        table = Table(box=None, pad_edge=False)
        for heading in ("run", "state", "progress", "rate", "left", "collisions", "memory"):
            table.add_column(heading, justify="left" if heading == "run" else "right", no_wrap=True)
        order = (Phase.RUNNING, Phase.FAILED, Phase.ELSEWHERE, Phase.QUEUED, Phase.DONE, Phase.SKIPPED)
        shown = sorted(self.board.runs, key=lambda run: order.index(run.phase))
        for run in shown[:ROWS_MAX]:
            # As plain text: a name in brackets is no markup.
            table.add_row(Text(run.spec.label), Text(str(run.phase)), *map(Text, cells(run)))
        more = f"; {len(shown) - ROWS_MAX} more not shown" if len(shown) > ROWS_MAX else ""
        return Group(table, Text(self.board.summary() + more))


def cells(run: RunStatus) -> tuple[str, str, str, str, str]:
    """Progress, rate, time left, running collision rate and memory of a run, for people."""
    if run.phase is not Phase.RUNNING:
        return ("", "", duration(run.seconds) if run.phase is Phase.DONE else "", "", "")
    # An epoch of the risk model takes ten seconds and more.
    scale, unit = {"evaluate": (1.0, "episodes/s"), "risk model": (60.0, "epochs/min")}.get(run.stage, (1.0, "steps/s"))
    left = run.eta_s
    collisions = run.scalars.get("collision_rate")
    return (
        f"{run.stage} {run.percent:.0f} %" if run.stage else "starting",
        f"{scale * run.rate:,.0f} {unit}" if run.rate > 0.0 else "",
        "" if left is None else duration(left),
        "" if collisions is None else f"{100.0 * collisions:.1f} %",
        _memory(run),
    )


def _memory(run: RunStatus) -> str:
    try:
        held = run.memory or psutil.Process(run.pid).memory_info().rss
    except psutil.Error:
        return ""
    return f"{held / 2**20:,.0f} MiB"


def choose_display(board: Board, quiet: bool) -> Display:
    """A live table on a terminal, lines elsewhere, nothing when quiet."""
    if quiet:
        return Silent(board)
    return LiveTable(board) if sys.stderr.isatty() else Lines(board)


class Steps:
    """A bar over a known number of steps on a terminal; nothing elsewhere, or when quiet. On standard error."""

    def __init__(self, what: str, total: int, quiet: bool) -> None:
        console = Console(stderr=True)
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[label]}"),
        )
        self._bar = Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal)
        self._task = self._bar.add_task(what, total=total, label="")
        self._begun = False

    def __enter__(self) -> Self:
        """Begin to draw."""
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Take the bar away."""
        self._bar.stop()

    def begin(self, label: str) -> None:
        """The next step has begun; the one before it is done."""
        self._bar.update(self._task, advance=1 if self._begun else 0, label=escape(label))
        self._begun = True

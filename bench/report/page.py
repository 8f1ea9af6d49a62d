"""The report as one HTML file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from algorithms import atomic
from bench.records import Collection
from bench.replay import page as player
from bench.replay.packed import ROAD
from bench.report.content import content
from bench.report.episodes import collect_episodes

FOLDER: Final = Path(__file__).parent
CHARTS: Final = "chart-4.6.1"
"""Chart.js, MIT licence: its text is in the page, too."""
SCRIPTS: Final = ("dom.js", "state.js", "board.js", "charts.js", "sections.js", "run.js", "main.js")
"""In the order in which they build on each other."""


def render(shown: dict[str, Any], episodes: dict[str, Any]) -> str:
    """The page of contents and episodes; the same values give the same text."""
    scripts = [(FOLDER / "assets" / name).read_text(encoding="utf-8") for name in SCRIPTS]
    parts = {
        "style": player.asset("player.css") + (FOLDER / "assets" / "report.css").read_text(encoding="utf-8"),
        "charts": (FOLDER / "vendor" / f"{CHARTS}.umd.min.js").read_text(encoding="utf-8"),
        "licence": (FOLDER / "vendor" / f"{CHARTS}.LICENSE.txt").read_text(encoding="utf-8"),
        "player": player.script(),
        "report": "\n".join(scripts),
        "data": player.embedded_json({**shown, "road": ROAD}),
        "episodes": player.embedded_json(episodes),
    }
    return player.fill((FOLDER / "assets" / "report.html").read_text(encoding="utf-8"), parts)


def write(
    collection: Collection, out: Path, cache: Path, progress: Callable[[str], None] = lambda _label: None
) -> Path:
    """Write ``index.html``; the same records give the same bytes.

    Args:
        collection: The records.
        out: Folder, made if missing.
        cache: Where driven episodes are kept between calls.
        progress: Called with the label of each run before its episodes are driven.

    Raises:
        RecordError: A record cannot be used.
    """
    page = render(content(collection), collect_episodes(collection.records, cache, progress))
    out.mkdir(parents=True, exist_ok=True)
    atomic.write_file(out / "index.html", page.encode())
    return out / "index.html"

"""A replay as one HTML file that needs nothing else."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from algorithms import atomic
from bench.replay.held_out import Replay
from bench.replay.packed import ROAD, packed

ASSETS: Final = Path(__file__).parent / "assets"
SCRIPTS: Final = ("unpack.js", "scene.js", "player.js")
"""In the order in which they build on each other."""


def asset(name: str) -> str:
    """Text of a file of the player."""
    return (ASSETS / name).read_text(encoding="utf-8")


def script() -> str:
    """The player's program."""
    return "\n".join(asset(name) for name in SCRIPTS)


def embedded_json(value: Any) -> str:
    """JSON that may stand in a script element: no text in it can end the element."""
    text = json.dumps(value, separators=(",", ":"), sort_keys=True, allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def fill(template: str, parts: Mapping[str, str]) -> str:
    """A template with ``{{name}}`` replaced by parts, each once, none of them searched again.

    Raises:
        KeyError: The template names a part that is not given.
    """
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match.group(1)], template)


def write_page(replays: Sequence[Replay], path: Path) -> int:
    """Write a page that plays episodes, one below the other; the number of episodes."""
    first = replays[0]
    title = f"{' against '.join(replay.title for replay in replays)}, episode {first.trace.number}"
    parts = {
        "title": html.escape(title),
        "style": asset("player.css"),
        "script": script(),
        "data": embedded_json({"road": ROAD, "replays": [packed(replay) for replay in replays]}),
    }
    atomic.write_file(path, fill(asset("page.html"), parts).encode())
    return len(replays)

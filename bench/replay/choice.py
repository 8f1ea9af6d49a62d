"""What is typed, as a record and an episode of it."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from bench import store
from bench.errors import UsageError
from bench.records import Record, read_record
from bench.schema import column
from bench.store import State, Store
from envs.world import Ending

WORST: Final = "worst"
CLOSEST: Final = "closest"
_LISTED: Final = 8


def find_record(results: Path, text: str) -> Record:
    """The finished record that a text names: its folder, or any part of the folder's name that no other has.

    Raises:
        UsageError: No run, several, or one without a finished record has such a name.
        RecordError: The record cannot be used.
    """
    folders = Store(results).folders()
    name = Path(text).name
    found = [path for path in folders if path.name == name] or [path for path in folders if text in path.name]
    if not found:
        raise UsageError(
            f"run {text!r}: {results / 'runs'} has no folder with this in its name; it has {len(folders)}."
        )
    if len(found) > 1:
        names = "".join(f"\n  {path.name}" for path in found[:_LISTED])
        more = f"\n  and {len(found) - _LISTED} more" if len(found) > _LISTED else ""
        raise UsageError(f"run {text!r} fits {len(found)} runs; type more of the name of one:{names}{more}")
    state = store.folder_state(found[0])
    if state is not State.DONE:
        raise UsageError(f"run {found[0].name} is {state}: only a finished run can be shown.")
    return read_record(found[0])


def choose_episode(episodes: pa.Table, text: str) -> int:
    """Number of a held-out episode.

    Args:
        episodes: Held-out episodes of a record, in order of number.
        text: The number; ``worst``: the first collision, else as ``closest``; ``closest``: of the episodes
            without a collision the one with the least time to collision.

    Raises:
        UsageError: There is no such episode.
    """
    if text in (WORST, CLOSEST):
        hit = column(episodes, "ending") == Ending.COLLISION
        if text == WORST and hit.any():
            return int(np.argmax(hit))
        if hit.all():
            raise UsageError(f"--episode {text}: every held-out episode ended in a collision; try --episode {WORST}.")
        safe = np.flatnonzero(~hit)
        return int(safe[np.argmin(column(episodes, "ttc_min")[safe])])
    if not text.isdecimal() or int(text) >= episodes.num_rows:
        raise UsageError(f"--episode {text}: must be {WORST}, {CLOSEST} or a number from 0 to {episodes.num_rows - 1}.")
    return int(text)

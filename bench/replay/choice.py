"""What is typed, as an episode of a record."""

from __future__ import annotations

from typing import Final

import numpy as np
import pyarrow as pa

from bench.errors import UsageError
from bench.schema import column
from envs.world import Ending

WORST: Final = "worst"
CLOSEST: Final = "closest"


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

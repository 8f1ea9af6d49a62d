"""What a user calls a cell, and which one he means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from bench.errors import UsageError
from bench.published import TITLES
from envs.scenario import UnknownNameError

BOARD: Final = "leaderboard"
NAMES: Final = (*TITLES, BOARD)
FORM: Final = "METHOD FIGURE STAGE"
BOARD_FORM: Final = f"{FORM} [SCENARIO] [COLUMN=VALUE ...]"


@dataclass(frozen=True, slots=True)
class Address:
    """One cell.

    Attributes:
        table: ``ablation``, ``collision`` or ``leaderboard``.
        method: As the column's heading or the method's name, as in ``Ours`` or ``dd-rq``.
        figure: Statistic as printed, or its name in the CSV files.
        stage: ``T`` or ``A``.
        scenario: Leaderboard only: ``a-v1`` or ``a``; empty for any.
        filters: Leaderboard only: other columns by value, to tell rows of one method apart.
    """

    table: str
    method: str
    figure: str
    stage: str
    scenario: str = ""
    filters: tuple[tuple[str, str], ...] = ()

    @property
    def text(self) -> str:
        """As it may be typed again."""
        words = [self.method, self.figure, self.stage, self.scenario, *(f"{k}={v}" for k, v in self.filters)]
        return " ".join(f'"{word}"' if " " in word else word for word in [self.table, *words] if word)


def parse(table: str, words: Sequence[str]) -> Address:
    """The address of a table's name and the words after it.

    Raises:
        UsageError: The table is unknown, or the words do not name a cell.
    """
    if table not in NAMES:
        raise UsageError(str(UnknownNameError("table", table, list(NAMES))))
    least, form = 3, BOARD_FORM if table == BOARD else FORM
    if len(words) < least or (table != BOARD and len(words) > least):
        raise UsageError(f"{' '.join(words) or 'Nothing'} names no cell of {table}: give {form}.")
    method, figure, stage, *rest = words
    if stage not in ("T", "A"):
        raise UsageError(f"Stage {stage!r}: give T (training) or A (application); the cell is {form}.")
    scenario = "" if not rest or "=" in rest[0].partition(":")[0] else rest.pop(0)
    wrong = [word for word in rest if "=" not in word]
    if wrong:
        raise UsageError(f"{wrong[0]!r} is no COLUMN=VALUE; the cell is {form}.")
    filters = tuple((word.partition("=")[0], word.partition("=")[2]) for word in rest)
    return Address(table, method, figure, stage, scenario, filters)

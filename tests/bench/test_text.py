"""Tables on a terminal and in a pipe say the same."""

import re
import sys

import pytest

from bench.text import columns

HEADING = ("method", "collisions")
ROWS = [("sac[bold]", "3/10"), ("dd-rq", "0/10 (<= 26 %)")]


def test_a_pipe_gets_one_line_a_row() -> None:
    assert columns(HEADING, ROWS).splitlines() == [
        "method     collisions",
        "---------  --------------",
        "sac[bold]  3/10",
        "dd-rq      0/10 (<= 26 %)",
    ]


@pytest.mark.parametrize(("term", "codes"), [("xterm-256color", True), ("dumb", False)])
def test_a_terminal_gets_a_drawn_table_with_every_cell(term: str, codes: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setenv("TERM", term)
    monkeypatch.setenv("COLUMNS", "60")
    for name in ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)
    drawn = columns(HEADING, ROWS)
    assert ("\x1b[1m" in drawn) == codes
    assert "\x1b[3" not in drawn  # bold headings, no colour
    for cell in (*HEADING, *ROWS[0], *ROWS[1]):
        assert cell in drawn


def test_a_narrow_terminal_wraps_a_long_cell_and_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "24")
    words = "the reason why it is not available here"
    drawn = re.sub(r"\x1b\[\d*m", "", columns(("method", "why"), [("cpo", words)]))
    lines = drawn.splitlines()
    assert all(len(line) <= 24 for line in lines)
    assert lines[0].split() == ["method", "why"]
    assert " ".join(lines[2:]).split() == ["cpo", *words.split()]

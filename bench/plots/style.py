"""One look for all figures, and one look for each method in all of them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

WIDTH_IN: Final = 6.3
"""Text width of a page [in]; fonts are as large in print as here."""
PNG_DPI: Final = 160
GREY: Final = "#7f7f7f"
PAPER_COLOUR: Final = "#404040"
"""Of what the paper prints."""

_RC: Final[dict[str, Any]] = {
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "axes.linewidth": 0.7,
    "lines.linewidth": 1.3,
    "lines.markersize": 4.5,
    "grid.linewidth": 0.4,
    "grid.color": "#dddddd",
    "pdf.fonttype": 42,
    "figure.dpi": 100,
}


@dataclass(frozen=True, slots=True)
class Look:
    """How a method is drawn.

    Attributes:
        label: For people.
        colour: Of Okabe and Ito's set or a shade of it.
        marker: Matplotlib's.
        line: Matplotlib's line style.
    """

    label: str
    colour: str
    marker: str
    line: Any = "-"


LOOKS: Final[dict[str, Look]] = {
    "dd-rq": Look("DD-RQ", "#0072B2", "o"),
    "dd-rq:tc=mean": Look("DD-RQ, mean $T_c$", "#5BA8D8", "v", "--"),
    "dd-rq:rq=shuffled": Look("DD-RQ, shuffled RQ", "#9CCBEA", "^", ":"),
    "dd-rq:rq=printed": Look("DD-RQ, printed RQ", "#56708C", "$p$", ":"),
    "dd-rq-plus": Look("DD-RQ-plus", "#009E73", "s"),
    "dd-rq-plus:share=mean": Look("DD-RQ-plus, mean share", "#4FC3A1", "D", "--"),
    "dd-rq-plus:share=shuffled": Look("DD-RQ-plus, shuffled", "#98DCC7", "d", ":"),
    "dd-rq-plus:aware=False": Look("DD-RQ-plus, unaware", "#00694D", "8", "-."),
    "safety-guard:tc=1.0": Look("guard, $T_c$ 1 s", "#F2C14E", "<", (0, (1, 1))),
    "safety-guard": Look("guard, $T_c$ 3 s", "#E69F00", ">", "-"),
    "safety-guard:tc=5.0": Look("guard, $T_c$ 5 s", "#B57A00", "h", "--"),
    "safety-guard:tc=7.0": Look("guard, $T_c$ 7 s", "#7A5200", "H", "-."),
    "safety-guard:aware=True": Look("guard, $T_c$ 3 s, aware", "#C49A00", "$a$", "--"),
    "safety-guard:aware=True,share=0.0": Look("reserve only, aware", "#9C6500", "$r$", ":"),
    "rss-guard": Look("RSS guard", "#332288", "p", "-."),
    "sac": Look("SAC", "#D55E00", "X"),
    "cpo": Look("CPO", "#CC79A7", "P"),
    "focops": Look("FOCOPS", "#882255", "*", "--"),
    "trpo-lag": Look("TRPO-Lag", "#000000", "x", "-."),
    "cruise": Look("cruise", "#8c8c8c", "1", ":"),
    "cruise+guard": Look("cruise + guard", "#8c8c8c", "2", "--"),
    "cruise+guard:tc=1.0": Look("cruise + guard, $T_c$ 1 s", "#8c8c8c", "|", "-."),
    "idm": Look("IDM", "#b0b0b0", "3", ":"),
    "constant-speed": Look("constant speed", "#b0b0b0", "_", "-."),
    "constant-speed+guard": Look("constant speed + guard", "#b0b0b0", ".", "--"),
    "random": Look("random", "#b0b0b0", "4", "-."),
    "random+guard": Look("random + guard", "#b0b0b0", "+", "--"),
}
"""In the order of legends."""
CORE: Final = ("dd-rq", "dd-rq-plus", "safety-guard", "rss-guard", "sac", "cpo", "focops", "trpo-lag")
"""In figures of curves: of the fixed guards only T_c 3, no controls; more lines would cover each other."""
SHORT: Final = 12
"""Entries of a legend that fit into four columns, whatever they are called."""
_OTHERS: Final = ("#44AA99", "#AA4499", "#999933", "#661100", "#6699CC")


def order(method: str) -> tuple[int, str]:
    """Place of a method in legends."""
    return (list(LOOKS).index(method) if method in LOOKS else len(LOOKS), method)


def look(method: str) -> Look:
    """The look of a method; one that is not known gets a colour by its name, always the same."""
    if method in LOOKS:
        return LOOKS[method]
    return Look(method, _OTHERS[sum(map(ord, method)) % len(_OTHERS)], ".", "--")


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Draw in this style, whatever the user's settings are."""
    with mpl.rc_context():
        mpl.rcdefaults()
        sns.set_theme(context="paper", style="ticks", rc=_RC)
        yield


def figure(rows: int, columns: int, height_in: float, **arguments: Any) -> tuple[Figure, Any]:
    """A figure of text width without a window, and its axes, always as an array of two axes."""
    drawn = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    FigureCanvasPdf(drawn)
    return drawn, drawn.subplots(rows, columns, squeeze=False, **arguments)


def tidy(axes: Axes, x: str = "", y: str = "", title: str = "") -> None:
    """Labels, a light grid, no box."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, loc="left")
    axes.grid(True)
    axes.set_axisbelow(True)
    sns.despine(ax=axes)


def legend(drawn: Figure, methods: Iterable[str], lines: bool = True) -> None:
    """One legend below all panels, of lines or of markers."""
    handles = [
        Line2D(
            [],
            [],
            color=look(name).colour,
            linestyle=look(name).line if lines else "",
            marker="" if lines else look(name).marker,
            label=look(name).label,
        )
        for name in sorted(methods, key=order)
    ]
    columns = 4 if len(handles) <= SHORT else 3
    drawn.legend(handles=handles, loc="outside lower center", ncols=min(columns, len(handles)))


def save(drawn: Figure, folder: Path, name: str) -> list[Path]:
    """Write ``name.pdf`` and ``name.png`` without dates: the same figure gives the same bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{name}.pdf", folder / f"{name}.png"]
    drawn.savefig(paths[0], metadata={"CreationDate": None, "ModDate": None, "Creator": None, "Producer": None})
    drawn.savefig(paths[1], dpi=PNG_DPI, metadata={"Software": None})
    return paths

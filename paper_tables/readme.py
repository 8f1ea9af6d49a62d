"""Put drawn tables into README.md and results/README.md: ``python -m paper_tables.readme``, last in ``make tables``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

FOLDER: Final = Path(__file__).resolve().parent
PAGES: Final = {FOLDER.parent / "README.md": FOLDER, FOLDER.parent / "results/README.md": FOLDER.parent / "results"}
"""Pages, and where the tables are drawn that each of them shows."""
_BLOCK: Final = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end of table -->)", re.DOTALL)


def refreshed(text: str, folder: Path) -> str:
    """The text with what stands between ``<!-- table: NAME -->`` and ``<!-- end of table -->`` taken from NAME.md.

    Raises:
        OSError: A table that the text names has not been drawn.
    """

    def block(match: re.Match[str]) -> str:
        _title, _, body = (folder / f"{match[2]}.md").read_text("utf-8").partition("\n")
        return f"{match[1]}{body.strip()}\n{match[3]}"

    return _BLOCK.sub(block, text)


if __name__ == "__main__":
    for page, drawn in PAGES.items():
        page.write_text(refreshed(page.read_text("utf-8"), drawn), "utf-8")

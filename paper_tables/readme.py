"""Put the drawn tables into the README: ``python -m paper_tables.readme``, the last step of ``make tables``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

FOLDER: Final = Path(__file__).resolve().parent
README: Final = FOLDER.parent / "README.md"
_BLOCK: Final = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end of table -->)", re.DOTALL)


def refreshed(text: str, folder: Path = FOLDER) -> str:
    """The text with what stands between ``<!-- table: NAME -->`` and ``<!-- end of table -->`` taken from NAME.md.

    Raises:
        OSError: A table that the text names has not been drawn.
    """

    def block(match: re.Match[str]) -> str:
        _title, _, body = (folder / f"{match[2]}.md").read_text("utf-8").partition("\n")
        return f"{match[1]}{body.strip()}\n{match[3]}"

    return _BLOCK.sub(block, text)


if __name__ == "__main__":
    README.write_text(refreshed(README.read_text("utf-8")), "utf-8")

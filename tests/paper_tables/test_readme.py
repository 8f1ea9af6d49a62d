"""The pages show the tables as they are drawn."""

from pathlib import Path

import pytest

from paper_tables.readme import PAGES, refreshed


@pytest.mark.parametrize(("page", "folder"), list(PAGES.items()), ids=["README.md", "results/README.md"])
def test_the_pages_hold_the_committed_tables(page: Path, folder: Path):
    text = page.read_text("utf-8")
    assert text.count("<!-- table: ") == {"paper_tables": 2, "results": 1}[folder.name]
    assert refreshed(text, folder) == text, "make tables writes them"


def test_a_block_is_replaced_and_the_rest_kept(tmp_path: Path):
    (tmp_path / "x.md").write_text("# Title\n\nnew\n", "utf-8")
    text = "before\n<!-- table: x -->\nold\n<!-- end of table -->\nafter\n"
    assert refreshed(text, tmp_path) == "before\n<!-- table: x -->\nnew\n<!-- end of table -->\nafter\n"


def test_a_table_that_was_not_drawn_is_an_error(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match=r"y\.md"):
        refreshed("<!-- table: y -->\n<!-- end of table -->", tmp_path)

"""The README shows the tables as they are drawn."""

from pathlib import Path

import pytest

from paper_tables.readme import README, refreshed


def test_the_readme_holds_the_committed_tables():
    text = README.read_text("utf-8")
    assert text.count("<!-- table: ") == 2
    assert refreshed(text) == text, "make tables writes them"


def test_a_block_is_replaced_and_the_rest_kept(tmp_path: Path):
    (tmp_path / "x.md").write_text("# Title\n\nnew\n", "utf-8")
    text = "before\n<!-- table: x -->\nold\n<!-- end of table -->\nafter\n"
    assert refreshed(text, tmp_path) == "before\n<!-- table: x -->\nnew\n<!-- end of table -->\nafter\n"


def test_a_table_that_was_not_drawn_is_an_error(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match=r"y\.md"):
        refreshed("<!-- table: y -->\n<!-- end of table -->", tmp_path)

"""Every code block of README.md and docs/ runs; how, and what is cut short, is in code_blocks.py."""

import contextlib
import io
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer.main

from bench.cli.commands import app
from tests.docs.code_blocks import Block, blocks, cheaper, clone, commands, pages

PER_BLOCK_S = 900


def run_python(block: Block, names: dict[str, Any]) -> None:
    """Run a block in this process; the blocks of a page share their names, as in one session."""
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile("\n" * (block.line - 1) + block.text, block.page, "exec"), names)


def run_shell(block: Block, folder: Path, environment: dict[str, str]) -> None:
    """Run a block as a script that ends at the first command that fails."""
    script = "\n".join(map(cheaper, commands(block)))
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script], cwd=folder, env=environment, text=True, timeout=PER_BLOCK_S,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.returncode == 0, f"{block.where}\n{script}\n{done.stdout[-3000:]}"


def pages_with(*languages: str) -> list[str]:
    return [page for page in pages() if any(block.language in languages for block in blocks(page))]


@pytest.mark.parametrize("page", pages_with("python"))
def test_the_python_of_a_page_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "page"}
    for block in blocks(page):
        if block.language == "python" and not block.slow:
            run_python(block, names)


def _parses(words: list[str]) -> None:
    """Parse a command line as `bench` does, without running it."""
    command, name = typer.main.get_command(app), "bench"
    while hasattr(command, "commands"):
        assert words, f"{name} needs a command"
        assert words[0] in command.commands, f"{name} has no command {words[0]}"
        name, command, words = f"{name} {words[0]}", command.commands[words[0]], words[1:]
    command.make_context(name, list(words))


@pytest.mark.parametrize("page", pages_with("bash"))
def test_the_commands_of_a_page_parse(page: str) -> None:
    for block in blocks(page):
        for line in commands(block):
            words = shlex.split(line)
            if Path(words[0]).name == "bench":
                try:
                    _parses(words[1:])
                except Exception as error:
                    pytest.fail(f"{block.where}: {line}: {error}")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="the pages are written for a POSIX shell")
@pytest.mark.parametrize("page", pages_with("bash"))
def test_all_blocks_of_a_page_run_in_order(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    environment = clone(tmp_path)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "page"}
    for block in blocks(page):
        if block.language == "python":
            run_python(block, names)
        else:
            run_shell(block, tmp_path, environment)


def test_a_fence_is_left_out_only_with_a_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "```bash\na\n```\n<!-- not executed: takes a day -->\n```bash\nb\n```\n```\nc\n```\n"
    (tmp_path / "page.md").write_text(
        text + "<!-- not executed: -->\n\n```python\nd\n```\n```text\ne\n```\n<!-- slow -->\n```python\nf\n```\n"
    )
    monkeypatch.setattr("tests.docs.code_blocks.ROOT", tmp_path)
    found = blocks("page.md")
    assert [(block.language, block.text, block.slow) for block in found] == [
        ("bash", "a\n", False), ("bash", "c\n", False), ("python", "d\n", False), ("python", "f\n", True)
    ]  # fmt: skip
    assert [block.line for block in found] == [2, 9, 14, 21]


def test_commands_are_taken_without_prompt_comment_and_line_break() -> None:
    block = Block("page.md", 1, "bash", "# why\n$ bench run \\\n    --algo sac   # a note\n\nbench list\n", False)
    assert commands(block) == ["bench run  --algo sac", "bench list"]


def test_budgets_are_cut_and_nothing_else() -> None:
    assert cheaper("bench run --protocol standard --algo sac") == "bench run --protocol smoke --algo sac"
    assert cheaper("bench stress guard --episodes 100000") == "bench stress guard --episodes 64"
    assert cheaper("bench run --protocol smoke --steps 9000") == "bench run --protocol smoke --steps 9000"

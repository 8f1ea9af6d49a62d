"""The code blocks of the documentation, and a folder that looks like a clone in which they run.

A block runs unless the line before it is ``<!-- not executed: WHY -->``; after ``<!-- slow -->`` only in the slow
suite.
Budgets are cut (`cheaper`), and ``make TARGET`` only has to be a target that exists: CI itself runs them.
"""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from markdown_it import MarkdownIt

ROOT = Path(__file__).resolve().parents[2]
SHELL = ("", "bash", "console", "sh", "shell")
"""A fence without a language counts as commands, so that none is left out by accident."""
NOT_EXECUTED = re.compile(r"<!-- not executed: \S.* -->")
SLOW = "<!-- slow -->"


@dataclass(frozen=True)
class Block:
    """A fenced block of a page; line is that of its first line of code."""

    page: str
    line: int
    language: str
    text: str
    slow: bool

    @property
    def where(self) -> str:
        return f"{self.page}:{self.line}"


def pages() -> list[str]:
    """README.md and the pages of docs/, relative to the root."""
    return ["README.md", *(f"docs/{path.name}" for path in sorted((ROOT / "docs").glob("*.md")))]


def blocks(page: str) -> list[Block]:
    """Executable blocks of a page, in order."""
    return list(_blocks(page, (ROOT / page).read_text("utf-8")))


def _blocks(page: str, text: str) -> Iterator[Block]:
    remark = ""
    for token in MarkdownIt("commonmark").parse(text):
        if token.type == "fence":
            language = (token.info.split() or [""])[0]
            if language in (*SHELL, "python") and not NOT_EXECUTED.fullmatch(remark):
                language = "python" if language == "python" else "bash"
                yield Block(page, (token.map or [0])[0] + 2, language, token.content, remark == SLOW)
        remark = token.content.strip() if token.type == "html_block" else ""


def cheaper(command: str) -> str:
    """The same command with a budget of seconds."""
    command = re.sub(r"--protocol (quick|standard|paper)\b", "--protocol smoke", command)
    command = re.sub(r"--(episodes|eval-episodes) [0-9]+", r"--\1 64", command)
    return re.sub(r"--repeats [0-9]+", "--repeats 5", command)


def commands(block: Block) -> list[str]:
    """Command lines of a shell block: continuation lines joined, prompts and comments taken off."""
    joined = re.sub(r"\\\n\s*", " ", block.text)
    lines = (re.sub(r"^\$ |(^|\s+)# .*$", "", line).strip() for line in joined.splitlines())
    return [line for line in lines if line]


def clone(folder: Path) -> dict[str, str]:
    """Fill a folder with what commands find in a clone; the committed records are links. Returns the environment."""
    for path in (ROOT / "results" / "runs").iterdir():
        (folder / "results" / "runs").mkdir(parents=True, exist_ok=True)
        (folder / "results" / "runs" / path.name).symlink_to(path)
    for path in (ROOT / "results").glob("*.*"):
        shutil.copy(path, folder / "results")
    shutil.copytree(ROOT / "paper_tables", folder / "paper_tables", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "examples").symlink_to(ROOT / "examples")
    programs = _virtual_environment(folder / ".venv")
    _script(programs / "bench", f'exec "{programs}/python" -m bench "$@"')
    _script(programs / "make", f'exec "{shutil.which("make")}" -C "{ROOT}" -n "$@" >/dev/null')
    return {**os.environ, "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}


def _virtual_environment(folder: Path) -> Path:
    """An environment that sees all packages of this one, and takes what a page installs. Returns its programs."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    packages = Path(sysconfig.get_path("purelib", vars={"base": str(folder)}))
    above = sysconfig.get_path("purelib")
    (packages / "above.pth").write_text(f"import site; site.addsitedir({above!r})\n")
    programs = folder / "bin"
    (programs / "activate").write_text("")  # it is on the path already
    return programs


def _script(path: Path, line: str) -> None:
    path.write_text(f"#!/bin/sh\n{line}\n")
    path.chmod(0o755)

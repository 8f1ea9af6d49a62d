"""Writes the page of all commands from the command line itself, each time that the site is built."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import typer.main
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from bench.cli.commands import app

PAGE: Final = "cli.md"
_INTRODUCTION: Final = """# Commands

All commands of `bench`, written from the program itself when this site was built. `bench COMMAND --help` prints the
same. Results go to standard output, progress and errors to standard error; `--json`, where a command has it, prints
one JSON value.

| exit code | meaning |
|---|---|
| 0 | done |
| 1 | something failed, or a check did not pass; the message or the output says what |
| 2 | a name or value that cannot be used; the message names it, and the nearest known one |
| 130 | interrupted |

"""


def commands() -> Iterator[tuple[str, Any]]:
    """Every command with its full name, as in ``bench speed engine``."""
    yield from _below("bench", typer.main.get_command(app))


def _below(name: str, command: Any) -> Iterator[tuple[str, Any]]:
    if not hasattr(command, "commands"):
        yield name, command
        return
    for word in sorted(command.commands):
        if not command.commands[word].hidden:
            yield from _below(f"{name} {word}", command.commands[word])


def page() -> str:
    """The page as Markdown."""
    return _INTRODUCTION + "\n\n".join(_section(name, command) for name, command in commands()) + "\n"


def _section(name: str, command: Any) -> str:
    context = command.context_class(command, info_name=name)
    first, _, rest = command.help.partition("\n\n")
    usage = " ".join([name, *command.collect_usage_pieces(context)])
    parts = [f"## {name}", " ".join(first.split()), " ".join(rest.split()), f"```text\n{usage}\n```"]
    rows = [_row(*parameter.get_help_record(context)) for parameter in command.params if not parameter.hidden]
    if rows:
        parts.append("| argument or option | meaning | default, range |\n|---|---|---|\n" + "\n".join(rows))
    return "\n\n".join(part for part in parts if part)


def _row(name: str, text: str) -> str:
    """A row of the table: typer writes defaults and ranges in brackets behind the text."""
    meaning, _, notes = text.partition("  [")
    if meaning.startswith("["):
        meaning, notes = "", meaning[1:]
    cells = (f"`{name}`", meaning, f"`{notes.rstrip(']')}`" if notes else "")
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """MkDocs calls this with the files that it found."""
    files.append(File.generated(config, PAGE, content=page()))
    return files

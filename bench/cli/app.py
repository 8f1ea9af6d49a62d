"""The application object and what its commands share: options, errors as messages, printing."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final, ParamSpec, TypeVar

import typer

from bench.errors import BenchError

P = ParamSpec("P")
T = TypeVar("T")

RESULTS: Final = Path("results")

app = typer.Typer(
    name="bench",
    help="Safe reinforcement learning for driving: run methods on constrained scenarios and compare them.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: rich's takes longer to import than everything else
    context_settings={"help_option_names": ["-h", "--help"]},
)


def group(name: str, text: str) -> typer.Typer:
    """A group of commands, ``bench NAME ...``."""
    commands = typer.Typer(help=text, no_args_is_help=True, rich_markup_mode=None)
    app.add_typer(commands, name=name)
    return commands


Results = Annotated[Path, typer.Option("--results", metavar="DIR", help="Results folder.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON value instead of text.")]


def reports_errors(command: Callable[P, T]) -> Callable[P, T]:
    """Turn expected errors into a message on standard error and an exit code, without a traceback."""

    @functools.wraps(command)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return command(*args, **kwargs)
        except BenchError as error:
            print(f"bench: {error}", file=sys.stderr)
            raise typer.Exit(error.exit_code) from None

    return wrapper


def show(text: Any) -> None:
    """Print at once, also into a pipe."""
    print(text, flush=True)

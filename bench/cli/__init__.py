"""The command line: parse, call, print. Everything heavy is imported inside the commands."""

from bench.cli import extending, judging, measuring, running, seeing  # noqa: F401  importing registers the commands
from bench.cli.app import app

__all__ = ["app", "main"]


def main() -> None:
    """Entry point of the console script."""
    app(prog_name="bench")

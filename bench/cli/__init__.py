"""The command line: parse, call, print. Everything heavy is imported inside the commands."""

import atexit
import gc
import sys
from collections.abc import Sequence

__all__ = ["main"]


def main() -> None:
    """Entry point of the console script."""
    atexit.register(gc.freeze)  # what is left at the end goes with the process; to look for garbage in it took 0.1 s
    try:
        if _forks_workers(sys.argv[1:]):
            from bench.fork_server import warm_up

            warm_up()  # before all else: what parses a command takes 0.25 s to import, what plans the runs 0.8 s
        from bench.cli.commands import app

        app(prog_name="bench")
    except KeyboardInterrupt:  # of commands that have begun, see `bench.cli.app.reports_errors`
        print("bench: interrupted.", file=sys.stderr)
        sys.exit(130)


def _forks_workers(arguments: Sequence[str]) -> bool:
    """Whether this is ``bench run`` on this machine, as far as can be told before it is parsed."""
    others = ("--dry-run", "--executor", "--help", "-h")
    return arguments[:1] == ["run"] and not any(argument.startswith(others) for argument in arguments)

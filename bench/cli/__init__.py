"""The command line: parse, call, print. Everything heavy is imported inside the commands."""

import atexit
import gc
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

__all__ = ["main"]


def main() -> None:
    """Entry point of the console script."""
    atexit.register(_end)
    arguments = sys.argv[1:]
    try:
        if _forks_workers(arguments):
            from bench.fork_server import warm_up

            warm_up()  # before all else: what parses a command takes 0.25 s to import, what plans the runs 0.8 s
        from bench.cli.commands import app

        app(prog_name="bench")
    except KeyboardInterrupt:
        _interrupted(arguments)
    except SystemExit as end:
        # typer makes an exit of it, without a word. A sweep that was stopped has said more, and is no such exit.
        if isinstance(getattr(end.__context__, "__cause__", None), KeyboardInterrupt):
            _interrupted(arguments)
        raise


def _end() -> None:
    """What is left at the end goes with the process: looking for garbage took 0.1 s, and no Ctrl-C counts any more."""
    gc.freeze()
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _interrupted(arguments: Sequence[str]) -> NoReturn:
    print("bench: interrupted." + " The same command goes on." * (arguments[:1] == ["run"]), file=sys.stderr)
    sys.exit(130)


def _forks_workers(arguments: Sequence[str]) -> bool:
    """Whether this is ``bench run`` on this machine, as far as can be told before it is parsed."""
    others = ("--dry-run", "--executor", "--help", "-h")
    return arguments[:1] == ["run"] and not any(argument.startswith(others) for argument in arguments)

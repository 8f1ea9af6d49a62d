"""All commands of the application object."""

from bench.cli import extending, judging, measuring, running, seeing  # noqa: F401  importing registers the commands
from bench.cli.app import app

__all__ = ["app"]

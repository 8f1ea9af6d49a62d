"""Errors of the runner. Every message names what is wrong and what to do about it."""

from __future__ import annotations

from typing import ClassVar


class BenchError(Exception):
    """Base of all errors that the command line reports without a traceback.

    Attributes:
        exit_code: What the process ends with.
    """

    exit_code: ClassVar[int] = 1


class UsageError(BenchError):
    """A name or value from the user cannot be used."""

    exit_code = 2


class RecordError(BenchError):
    """A record is truncated, foreign, duplicated or of another version."""


class AlreadyDoneError(BenchError):
    """The run is done; nothing that is done is ever changed."""


class LockedError(BenchError):
    """Another process works on this run."""


class RunFailedError(BenchError):
    """A run failed; its folder holds the reason."""


class LearnerDivergedError(BenchError):
    """A learner reported a number that is not finite."""


class WorkerDiedError(BenchError):
    """A worker process ended in the middle of a run."""

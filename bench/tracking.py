"""``--track``: a learner's scalars in TensorBoard or MLflow while it trains."""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from bench.errors import UsageError
from bench.spec import RunSpec
from bench.training_log import Report

TRACKERS: Final = {"tensorboard": "pip install '.[track]'", "mlflow": "pip install mlflow"}
"""What scalars can be sent to, and how to install it."""
FOLDER: Final = "track"
"""Below the results folder: ``track/tensorboard/<run>``, ``track/mlflow``."""


def require_tracker(kind: str | None) -> None:
    """Check a name before any run begins.

    Raises:
        UsageError: It is unknown, or not installed.
    """
    if kind is None:
        return
    if kind not in TRACKERS:
        raise UsageError(f"--track {kind}: must be one of {', '.join(TRACKERS)}.")
    if importlib.util.find_spec(kind) is None:
        raise UsageError(f"--track {kind}: the package {kind} is not installed; {TRACKERS[kind]}.")


@contextlib.contextmanager
def tracked(kind: str | None, spec: RunSpec, results: Path, report: Report) -> Iterator[Report]:
    """A report that also sends scalars to a tracker, by simulation steps, as they come.

    Args:
        kind: One of `TRACKERS`, or None for the report alone.
        spec: Names the run there.
        results: The results folder.
        report: Told as before.
    """
    if kind is None:
        yield report
        return
    folder = results / FOLDER / kind
    folder.mkdir(parents=True, exist_ok=True)
    with (_tensorboard if kind == "tensorboard" else _mlflow)(spec, folder) as send:

        def both(stage: str, done: int, total: int, scalars: Mapping[str, float]) -> None:
            if scalars:
                send({f"{stage}/{name}": float(value) for name, value in scalars.items()}, done)
            report(stage, done, total, scalars)

        yield both


Send = Callable[[Mapping[str, float], int], None]


@contextlib.contextmanager
def _tensorboard(spec: RunSpec, folder: Path) -> Iterator[Send]:
    from torch.utils.tensorboard import SummaryWriter

    writer: Any = SummaryWriter(str(folder / spec.folder_name), flush_secs=5)

    def send(scalars: Mapping[str, float], step: int) -> None:
        for name, value in scalars.items():
            writer.add_scalar(name, value, step)
        writer.flush()

    try:
        yield send
    finally:
        writer.close()


@contextlib.contextmanager
def _mlflow(spec: RunSpec, folder: Path) -> Iterator[Send]:
    import mlflow

    mlflow.set_tracking_uri(folder.resolve().as_uri())
    mlflow.set_experiment(spec.scenario_id)
    with mlflow.start_run(run_name=spec.folder_name):
        mlflow.log_params({key: value for key, value in spec.model_dump().items() if key != "settings"})
        yield lambda scalars, step: mlflow.log_metrics(dict(scalars), step=step)

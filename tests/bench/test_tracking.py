"""Scalars reach a tracker while a run goes on, by simulation steps."""

import importlib.util
import sys
import types
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from bench import tracking
from bench.errors import UsageError
from bench.runner import run
from bench.spec import RunSpec
from bench.tracking import require_tracker, tracked

Make = Callable[..., RunSpec]
needs_tensorboard = pytest.mark.skipif(
    importlib.util.find_spec("tensorboard") is None, reason="tensorboard is not installed (the extra track)"
)


@needs_tensorboard
def test_tensorboard_shows_scalars_while_the_run_goes_on(fakes: Path, tmp_path: Path, make_spec: Make) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    seen: list[list[tuple[int, float]]] = []

    def read() -> list[tuple[int, float]]:
        events = EventAccumulator(str(tmp_path / "track" / "tensorboard" / make_spec().folder_name)).Reload()
        return [(event.step, event.value) for event in events.Scalars("train/loss")]

    def report(stage: str, done: int, _total: int, scalars: Any) -> None:
        if stage == "train" and scalars and len(seen) < 2:
            seen.append(read())

    with tracked("tensorboard", make_spec(), tmp_path, report) as both:
        run(make_spec(), tmp_path, both)
    assert [len(points) for points in seen] == [1, 2], "live, not at the end"
    final = read()
    assert [step for step, _ in final] == list(range(200, 2_001, 200))
    assert final[0][1] == pytest.approx(0.1)


def test_mlflow_gets_scalars_under_the_runs_name(
    tmp_path: Path, make_spec: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[Any] = []
    fake = types.ModuleType("mlflow")
    fake.set_tracking_uri = lambda uri: calls.append(uri)
    fake.set_experiment = lambda name: calls.append(name)
    fake.start_run = lambda run_name: nullcontext(calls.append(run_name))
    fake.log_params = lambda parameters: calls.append(parameters["seed"])
    fake.log_metrics = lambda scalars, step: calls.append((scalars, step))
    monkeypatch.setitem(sys.modules, "mlflow", fake)
    with tracked("mlflow", make_spec(), tmp_path, lambda *_: None) as report:
        report("train", 40, 100, {"loss": 1.5})
        report("train", 60, 100, {})
    uri = (tmp_path / "track" / "mlflow").resolve().as_uri()
    assert calls == [uri, "a-v1", make_spec().folder_name, 0, ({"train/loss": 1.5}, 40)]


def test_an_unknown_or_missing_tracker_is_refused_before_anything_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    require_tracker(None)
    with pytest.raises(UsageError, match="--track wandb: must be one of tensorboard, mlflow"):
        require_tracker("wandb")
    monkeypatch.setattr(tracking.importlib.util, "find_spec", lambda _name: None)
    with pytest.raises(UsageError, match="mlflow is not installed; pip install mlflow"):
        require_tracker("mlflow")

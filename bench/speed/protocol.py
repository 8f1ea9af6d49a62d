"""``bench speed protocol``: where the time of a run goes, by method."""

from __future__ import annotations

import functools
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from unittest import mock

from bench.protocols import PROTOCOLS, Request, expand
from bench.runner import run
from bench.spec import RunSpec

ENGINE, GUARD, RISK_MODEL, POLICY, UPDATE, STORE = "engine", "guard", "risk_model", "policy", "update", "store"
REPLAY, OTHER = "replay", "other"
PARTS: Final = (ENGINE, GUARD, RISK_MODEL, POLICY, UPDATE, REPLAY, STORE, OTHER)
SHARED: Final = "shared"
"""Training of what all seeds share, driving agent and risk model: no part of a run, whichever seed comes first."""
WARM_UP: Final = PROTOCOLS["smoke"]


@dataclass(slots=True)
class Stopwatch:
    """Processor time spent in named parts, without what the parts called inside spent, unless inside `SHARED`.

    Attributes:
        seconds: Exclusive processor time by part [s].
    """

    seconds: dict[str, float] = field(default_factory=dict)
    _running: list[str] = field(default_factory=lambda: [OTHER])
    _since: float = field(default_factory=time.process_time)

    def switch(self) -> None:
        """Credit the time since the last switch to the part that is running."""
        now = time.process_time()
        part = self._running[-1]
        self.seconds[part] = self.seconds.get(part, 0.0) + now - self._since
        self._since = now

    @contextmanager
    def timed(self, owner: Any, name: str, part: str) -> Iterator[None]:
        """Count the calls of a function or method as a part, for as long as the context lasts."""
        original: Callable[..., Any] = getattr(owner, name)

        @functools.wraps(original)
        def wrapper(*arguments: Any, **named: Any) -> Any:
            if SHARED in self._running:
                return original(*arguments, **named)
            self.switch()
            self._running.append(part)
            try:
                return original(*arguments, **named)
            finally:
                self.switch()
                self._running.pop()

        with mock.patch.object(owner, name, wrapper):
            yield

    def shares(self) -> dict[str, float]:
        """Share of each part of a run that took any time; they sum to 1."""
        self.switch()
        total = sum(self.seconds.values()) - self.seconds.get(SHARED, 0.0)
        return {part: self.seconds[part] / total for part in PARTS if part in self.seconds}


def _places(spec: RunSpec) -> list[tuple[Any, str, str]]:
    """Owner, name and part of every callable that is timed in a run of this method."""
    from stable_baselines3 import SAC as StableBaselinesSAC

    from algorithms import risk_training
    from algorithms.fast_sac import FastSAC
    from algorithms.networks import NetworkPolicy
    from algorithms.risk_model import RiskModel
    from algorithms.safety_guard import SafetyGuard
    from bench.store import RunFolder
    from envs.driving_env import DrivingVectorEnv

    places: list[tuple[Any, str, str]] = [
        (DrivingVectorEnv, "step", ENGINE),
        (SafetyGuard, "filter", GUARD),
        (RiskModel, "__call__", RISK_MODEL),
        (NetworkPolicy, "act", POLICY),
        (FastSAC, "predict", POLICY),
        (FastSAC, "train", UPDATE),
        (StableBaselinesSAC, "_store_transition", REPLAY),
        (risk_training, "risk_model", SHARED),
        *((RunFolder, name, STORE) for name in ("write", "write_run", "write_policy", "finish")),
    ]
    return places + _omnisafe_places(spec)


def _omnisafe_places(spec: RunSpec) -> list[tuple[Any, str, str]]:
    from algorithms import omnisafe_speed
    from algorithms.omnisafe_library import omnisafe_module
    from algorithms.omnisafe_methods import OnPolicyMethod
    from algorithms.registry import get_method

    method = get_method(spec.method)
    if not isinstance(method, OnPolicyMethod):
        return []
    trainer = getattr(omnisafe_module("omnisafe.algorithms.on_policy"), method.algorithm)
    return [(trainer, "_update", UPDATE), (omnisafe_speed, "lean_step", POLICY)]


def profile(spec: RunSpec, results: Path) -> dict[str, Any]:
    """Shares and speed of one run, from an empty cache.

    Returns:
        ``share`` by part and ``steps_per_s`` of training (simulation steps of 0.1 s), both without the ``shared_s``
        that training what all seeds share took; ``evaluate_s`` for ``eval_episodes``; ``seconds`` in all.
    """
    watch = Stopwatch()
    with ExitStack() as stack:
        for owner, name, part in _places(spec):
            stack.enter_context(watch.timed(owner, name, part))
        record = run(spec, results)
    timing = record.details["timing"]
    share, shared_s = watch.shares(), watch.seconds.get(SHARED, 0.0)
    return {
        "share": share,
        "shared_s": shared_s,
        "steps_per_s": spec.steps / (timing["train"]["cpu_s"] - shared_s) if spec.steps else None,
        "evaluate_s": timing["evaluate"]["cpu_s"],
        "eval_episodes": spec.eval_episodes,
        "seconds": sum(watch.seconds.values()),
    }


def _small(spec: RunSpec) -> RunSpec:
    """A run that imports and compiles what a process or a machine does once; that is no part of a run."""
    update = {"steps": min(spec.steps, WARM_UP.steps), "eval_episodes": WARM_UP.eval_episodes}
    return spec.model_copy(update=update)


def protocol(request: Request) -> dict[str, dict[str, Any]]:
    """Profile of one run (seed 0) of each method of a request, one after another in this process, on one thread.

    Raises:
        UsageError: Something in the request cannot be used.
        RunFailedError: A run failed.
    """
    specs: Sequence[RunSpec] = expand(request).specs
    measured: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for number, spec in enumerate(specs):
            run(_small(spec), Path(folder) / f"{number}-warm-up")
            measured.setdefault(spec.method, profile(spec, Path(folder) / str(number)))
    return measured


def as_text(measured: dict[str, dict[str, Any]]) -> str:
    """The figures for people."""
    from bench.text import columns

    heading = ("method", "steps/s", *PARTS, "shared by seeds")
    rows = [
        (
            method,
            "" if found["steps_per_s"] is None else f"{found['steps_per_s']:,.0f}",
            *(f"{100.0 * found['share'][part]:.1f} %" if part in found["share"] else "" for part in PARTS),
            f"{found['shared_s']:,.0f} s" if found["shared_s"] else "",
        )
        for method, found in measured.items()
    ]
    return f"{columns(heading, rows)}\nload average {os.getloadavg()[0]:.2f}"

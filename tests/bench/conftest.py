"""Fake methods as an installed plugin, and records made from nothing."""

import importlib
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from bench import schema, store
from bench.cli.commands import app
from bench.spec import RunSpec
from bench.store import Store
from envs.world import EPISODE, Ending, Fault

FAKE_METHODS = """
import json, os, resource, signal, time
from pathlib import Path
import numpy as np
import psutil
from algorithms.method import Method, Policy

class Fixed(Policy):
    def __init__(self, action):
        self.action = action
    def act(self, observations):
        return np.tile(self.action, (len(observations), 1))
    def save(self, folder):
        (folder / "action.json").write_text(json.dumps(list(self.action)))

class Learner(Method):
    setting_names = ("pace",)
    defaults = {"offset": 0.0, "bias": 1.0}
    def train(self, task):
        env = task.make_env(4)
        env.reset()
        rng = np.random.default_rng(task.stream("policy"))
        while env.decisions < env.decision_limit:
            env.step(rng.uniform([-3.5, -2.0], [3.5, 2.0], (4, 2)))
            self.after(task, env)
        return Fixed((self.parameters["offset"], 0.1 * float(task.settings.get("pace", "1"))))
    def after(self, task, env):
        if env.decisions % 10 == 0:
            task.progress(env.steps_done, {"loss": 1.0 / env.decisions})
    def load_policy(self, folder, task):
        return Fixed(json.loads((folder / "action.json").read_text()))

class Failing(Learner):
    def after(self, task, env):
        if env.decisions == 12:
            raise RuntimeError("the learner tripped")

class Diverging(Learner):
    def after(self, task, env):
        task.progress(env.steps_done, {"loss": float("nan") if env.decisions == 7 else 1.0})

class Dying(Learner):
    def after(self, task, env):
        task.progress(env.steps_done, {})
        if env.decisions == 12:
            os.kill(os.getpid(), signal.SIGKILL)

class Endless(Learner):
    def after(self, task, env):
        task.progress(env.steps_done, {})
        Path(os.environ["FAKE_SIGN"]).write_text("training")
        time.sleep(0.05)

class Hungry(Learner):
    def after(self, task, env):
        if env.decisions == 12:
            size = psutil.Process().memory_info().vms
            before = resource.getrlimit(resource.RLIMIT_AS)
            resource.setrlimit(resource.RLIMIT_AS, (size + 2**28, before[1]))
            try:
                np.ones(2**28)
            finally:
                resource.setrlimit(resource.RLIMIT_AS, before)

class Greedy(Learner):
    def train(self, task):
        policy = super().train(task)
        task._env.step(np.zeros((4, 2)))
        return policy

class Scripted(Method):
    trains = False
    def train(self, task):
        return Fixed((0.0, 0.0))
    def load_policy(self, folder, task):
        return Fixed((0.0, 0.0))
"""
CLASSES = ("Learner", "Failing", "Diverging", "Dying", "Endless", "Hungry", "Greedy", "Scripted")
BROKEN = "broken = fake_methods_that_are_not_there:Broken"


@pytest.fixture
def fakes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Methods fake-learner, fake-failing, ... as an installed distribution; returns the folder it is in."""
    folder = tmp_path / "site"
    info = folder / "fake_methods-1.0.dist-info"
    info.mkdir(parents=True)
    (folder / "fake_methods.py").write_text(FAKE_METHODS)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: fake-methods\nVersion: 1.0\n")
    points = [f"fake-{name.lower()} = fake_methods:{name}" for name in CLASSES]
    (info / "entry_points.txt").write_text("\n".join(["[bench.methods]", *points, BROKEN, ""]))
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setenv("PYTHONPATH", f"{folder}:{Path(__file__).resolve().parents[2]}")
    monkeypatch.setenv("FAKE_SIGN", str(tmp_path / "sign"))
    importlib.invalidate_caches()
    yield folder
    sys.modules.pop("fake_methods", None)


@pytest.fixture
def bench() -> Callable[..., Result]:
    """Runs the command line in this process."""

    def call(*arguments: object) -> Result:
        return CliRunner().invoke(app, [*map(str, arguments)])

    return call


@pytest.fixture
def make_spec() -> Callable[..., RunSpec]:
    """Specifications of a small run."""

    def make(**changes: Any) -> RunSpec:
        fields: dict[str, Any] = {
            "method": "fake-learner",
            "method_version": 1,
            "scenario": "a",
            "scenario_version": 1,
            "seed": 0,
            "steps": 2_000,
            "eval_episodes": 20,
        }
        return RunSpec(**{**fields, **changes})

    return make


@pytest.fixture
def make_record(make_spec: Callable[..., RunSpec]) -> Callable[..., Path]:
    """Writes a finished record with drawn episodes, without running anything."""

    def make(
        results: Path,
        collisions: int = 0,
        train_collisions: int = 0,
        trained: int = 50,
        look: Mapping[str, float] | None = None,
        **changes: Any,
    ) -> Path:
        return write_record(results, make_spec(**changes), collisions, train_collisions, trained, look or {})

    return make


@pytest.fixture(scope="session")
def standard_results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seeds of all methods of both tables as the paper describes them: every claim holds. Read only."""
    results = tmp_path_factory.mktemp("standard")
    for scenario, methods in STANDARD.items():
        for method, (collisions, look) in methods.items():
            for seed in range(3):
                spec = RunSpec(
                    method=method,
                    method_version=1,
                    scenario=scenario,
                    scenario_version=1,
                    seed=seed,
                    steps=500_000,
                    eval_episodes=2_500,
                )
                write_record(results, spec, collisions * 5 // 2, collisions, 900, look)
    return results


OURS = {"speed_mps": 12.6, "flagged": 0.02, "pay": 3.0}
GUARD = {"speed_mps": 11.9, "flagged": 0.06, "pay": 2.5}
FREE = {"speed_mps": 13.0, "flagged": 0.0, "pay": 2.0}
STANDARD = {
    "a": {
        "dd-rq": (0, OURS),
        "dd-rq:tc=mean": (0, {**OURS, "speed_mps": 12.0}),
        "dd-rq:rq=shuffled": (0, OURS),
        **{f"safety-guard{tc}": (0, GUARD) for tc in (":tc=1.0", "", ":tc=5.0", ":tc=7.0")},
        "sac": (400, FREE),
    },
    "b": {
        "dd-rq": (0, OURS),
        "safety-guard": (0, GUARD),
        **{method: (600, FREE) for method in ("sac", "cpo", "focops", "trpo-lag")},
    },
}


def write_record(
    results: Path, spec: RunSpec, collisions: int, train_collisions: int, trained: int, look: Mapping[str, float]
) -> Path:
    """A finished record of drawn episodes."""
    with Store(results).begin(spec) as folder:
        folder.write_run(
            {
                "provenance": {"git": {"commit": "0" * 40, "dirty": False}},
                "steps_done": spec.steps,
                "timing": {
                    "train": {"wall_s": 2.0, "cpu_s": 1.5},
                    "evaluate": {"wall_s": 1.0, "cpu_s": 0.5},
                },
                "timeline": [[spec.steps // 2, 0.5], [spec.steps, 2.0]] if spec.steps else [],
                "trains": spec.steps > 0,
            }
        )
        folder.write_policy(lambda path: (path / "action.json").write_text("[0, 0]") and None)
        episodes = drawn_episodes(trained if spec.steps else 0, train_collisions, spec.seed, **look)
        episodes["end_step"] = np.linspace(0, spec.steps, len(episodes) + 1)[1:].astype(np.int64)
        evaluated = drawn_episodes(spec.eval_episodes, collisions, spec.seed + 100, **look)
        folder.write(store.TRAIN_FILE, schema.to_bytes(schema.episodes_table(episodes)))
        folder.write(store.EVAL_FILE, schema.to_bytes(schema.episodes_table(evaluated)))
        folder.write(store.SCALARS_FILE, schema.to_bytes(schema.scalars_table([])))
        folder.finish()
    return folder.path


def drawn_episodes(
    count: int, collisions: int, seed: int, speed_mps: float = 12.0, flagged: float = 0.02, pay: float = 2.0
) -> np.ndarray:
    """So many episodes of 100 to 900 steps; the first ones end in a side collision, the rest at the goal.

    Args:
        count: Episodes.
        collisions: Of them.
        seed: Of the lengths.
        speed_mps: Of each episode [m/s].
        flagged: Share of steps with an intervention, rounded down in each episode.
        pay: Driving reward of a step.
    """
    rng = np.random.default_rng(seed)
    episodes = np.zeros(count, EPISODE)
    episodes["episode"] = np.arange(count)
    episodes["steps"] = rng.integers(100, 901, count)
    episodes["ending"] = np.where(np.arange(count) < collisions, Ending.COLLISION, Ending.GOAL)
    episodes["fault"] = np.where(np.arange(count) < collisions, Fault.SIDE, Fault.NONE)
    episodes["ego_at_fault"] = np.arange(count) < collisions
    episodes["distance"] = 0.1 * speed_mps * episodes["steps"]
    episodes["interventions"] = flagged * episodes["steps"]
    episodes["return_driving"] = pay * episodes["steps"]
    episodes["return_comfort"] = -1.0
    episodes["ttc_min"] = np.where(np.arange(count) % 4, 1.0 + np.arange(count) % 7, np.inf)
    return episodes

"""The driving agent pi_phi (paper, Sec. III): SAC over [T_c, d_fn, s_dot_f], trained once and shared."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from algorithms.artefacts import cached, digest
from algorithms.checkpoints import FileCheckpoints
from algorithms.identity import learning_identity
from algorithms.method import Budget, Progress, Task
from algorithms.networks import NetworkPolicy
from algorithms.sac import SACSettings
from algorithms.sac_training import train_sac
from algorithms.versions import AGENT_VERSION
from envs.driving_env import ActionMode
from envs.observation import LAYOUT_VERSION
from envs.scenario import get_scenario


@dataclass(frozen=True, slots=True)
class DrivingAgentSpec:
    """What a driving agent is trained on; its hash names the cached artefact.

    Attributes:
        scenario: Name of the scenario.
        steps: Simulation steps of 0.1 s.
        seed: Replicate; one agent serves all seeds of the methods that ask for it. Its streams (`Task.stream`) are
            those of the runs of the same replicate: replicate 0 of every method meets the agent's training episodes.
    """

    scenario: str
    steps: int
    seed: int = 0

    @property
    def key(self) -> str:
        """Folder name in the cache; `AGENT_VERSION` stands for what is in code alone (discount, layers, reward).

        ``risk.json`` of every run with a risk model holds it, under the record's seal: what renames an agent whose
        bits are the same breaks `bench rerun` of those records.
        """
        learner = asdict(SACSettings())
        layout = {"layout": LAYOUT_VERSION, "version": AGENT_VERSION}
        identity = {"id": get_scenario(self.scenario).id, **asdict(self), **learner, **layout}
        return f"driving-agent-{digest(identity)}"


@dataclass(frozen=True, slots=True)
class _Curve:
    """The learning curve of an agent, through kills and resumes."""

    points: list[dict[str, float]]
    progress: Progress

    def record(self, steps: int, scalars: Mapping[str, float]) -> None:
        self.points.append({"steps": steps, **scalars})
        self.progress(steps, scalars)

    def snapshot(self) -> dict[str, Any]:
        return {"points": list(self.points)}

    def restore(self, values: dict[str, Any], steps: int, at: str) -> None:
        self.points[:] = values["points"]
        self.progress(steps, {})


def driving_agent(
    spec: DrivingAgentSpec,
    cache: Path,
    progress: Progress = lambda _steps, _scalars: None,
    waiting: Callable[[], None] = lambda: None,
) -> NetworkPolicy:
    """The trained agent, from the cache or trained now; ``agent.json`` beside it keeps the learning curve.

    A training that was killed goes on from its last checkpoint, whoever asks for the agent next.
    """
    curve = _Curve([], progress)
    checkpoints = FileCheckpoints(cache / f"{spec.key}.checkpoints", learning_identity(spec.key), curve)

    def build(folder: Path) -> None:
        scenario = get_scenario(spec.scenario)
        task = Task(
            scenario, spec.seed, Budget(spec.steps), cache=cache, progress=curve.record, checkpoints=checkpoints
        )
        policy = train_sac(task, action_mode=ActionMode.PLANNING, comfort=False)
        policy.save(folder)
        description = {"spec": asdict(spec), "scenario": scenario.id, "version": AGENT_VERSION, "curve": curve.points}
        (folder / "agent.json").write_text(json.dumps(description, indent=1, sort_keys=True) + "\n")

    built = cached(cache / spec.key, build, waiting)
    checkpoints.clear()
    return NetworkPolicy.load(built)

"""The contract: what a method gets (Task), what it must give (Policy), and who stands between (Shield)."""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

from algorithms.artefacts import Making
from algorithms.checkpoints import Checkpoints, NoCheckpoints
from envs.scenario import Scenario
from envs.terms import ActionMode, BudgetExceededError, CostSignal
from envs.world import Records, Shield, no_episodes

if TYPE_CHECKING:  # the engine's compiler is imported with the first environment: a plan of runs needs none
    from envs.driving_env import DrivingVectorEnv
    from envs.layout import EpisodeSource

__all__ = ["Budget", "BudgetExceededError", "Method", "Policy", "Shield", "Task", "seed_sequence"]

Observations = npt.NDArray[np.float32]
Actions = npt.NDArray[np.float64]
Progress = Callable[[int, Mapping[str, float]], None]


def seed_sequence(*components: str | int) -> np.random.SeedSequence:
    """Seed derived from named components: the same names give the same stream, on every machine.

    Example: ``seed_sequence("a-v1", "train", 3)``.
    """
    text = "\x1f".join(str(component) for component in components)
    return np.random.SeedSequence(int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "big"))


@dataclass(frozen=True, slots=True)
class Budget:
    """Simulation steps of 0.1 s, summed over all worlds: the same currency for every method."""

    steps: int

    def decisions(self, scenario: Scenario) -> int:
        """Policy decisions that the budget pays for.

        Raises:
            ValueError: The budget is not a positive multiple of the decision period.
        """
        if self.steps <= 0 or self.steps % scenario.substeps:
            raise ValueError(
                f"steps = {self.steps}: must be a positive multiple of {scenario.substeps} "
                f"(one decision is {scenario.substeps} simulation steps of 0.1 s)."
            )
        return self.steps // scenario.substeps


class Policy(ABC):
    """Maps observations to actions, deterministically given its seed; saved without pickle.

    Attributes:
        shield: Stays on in application, or None.
        action_mode: Which action the policy gives.
    """

    shield: Shield | None = None
    action_mode: ActionMode = ActionMode.ACCELERATION

    def begin(self, worlds: int, seed: np.random.SeedSequence) -> None:  # noqa: B027
        """Called before a roll-out of so many worlds; a policy that draws numbers seeds itself here."""

    @abstractmethod
    def act(self, observations: Observations) -> Actions:
        """Actions (N, A) in physical units [m, m/s2] for observations (N, 47)."""

    @abstractmethod
    def save(self, folder: Path) -> None:
        """Write weights as safetensors and the rest as JSON into an existing, empty folder."""


@dataclass(slots=True)
class Task:
    """What a method trains on.

    Attributes:
        scenario: The constrained MDP.
        seed: Replicate number; every stream is derived from it by name (`stream`).
        budget: Simulation steps that training may use.
        cost_limit: Bound on the undiscounted episode cost.
        cost_signal: What costs 1.
        settings: ``--set`` values for the method, for example ``{"learner": "sb3"}`` of ``sac.learner``.
        cache: Folder for artefacts shared between runs (driving agent, risk model).
        progress: Called with (simulation steps done, scalars) as training goes on.
        making: Called with (what, done, of how much) while artefacts that runs share are being made.
        checkpoints: Where a learner may keep its state, to go on after a kill; see `algorithms.checkpoints`.
    """

    scenario: Scenario
    seed: int
    budget: Budget
    cost_limit: float = 0.05
    cost_signal: CostSignal = CostSignal.COLLISION
    settings: Mapping[str, str] = field(default_factory=dict)
    cache: Path = Path("results/cache")
    progress: Progress = lambda _steps, _scalars: None
    making: Making = lambda _what, _done, _total: None
    checkpoints: Checkpoints = field(default_factory=NoCheckpoints)
    _env: DrivingVectorEnv | None = None

    def stream(self, name: str) -> np.random.SeedSequence:
        """The seed stream of a name within this task, for example ``policy``."""
        return seed_sequence(self.scenario.id, self.seed, name)

    def torch_seed(self) -> int:
        """Seed for a learner's own generators, 32 bits."""
        return int(self.stream("policy").generate_state(1)[0])

    def make_env(
        self,
        worlds: int,
        shield: Shield | None = None,
        action_mode: ActionMode = ActionMode.ACCELERATION,
        comfort: bool = True,
    ) -> DrivingVectorEnv:
        """The training environment: once per task, it counts the budget and keeps every finished episode.

        Raises:
            RuntimeError: A second call.
            ValueError: The budget is not a multiple of worlds x decision period.
        """
        from envs.driving_env import DrivingVectorEnv

        if self._env is not None:
            raise RuntimeError("make_env was called twice: a task has one training environment.")
        decisions = self.budget.decisions(self.scenario)
        if decisions % worlds:
            step = worlds * self.scenario.substeps
            near = max(1, round(self.budget.steps / step)) * step
            raise ValueError(
                f"steps = {self.budget.steps} with {worlds} worlds: must be a multiple of {step}; nearest: {near}."
            )
        self._env = DrivingVectorEnv(
            self.scenario,
            worlds,
            shield=shield,
            action_mode=action_mode,
            comfort=comfort,
            cost_signal=self.cost_signal,
            source=self.episodes(),
            decision_limit=decisions // worlds,
            watched=True,
        )
        return self._env

    def episodes(self) -> EpisodeSource:
        """Initial states of the training episodes."""
        from envs.layout import EpisodeSource

        return EpisodeSource(self.scenario, self.stream("train"))

    def steps_done(self) -> int:
        """Simulation steps used so far."""
        return 0 if self._env is None else self._env.steps_done

    def finished_episodes(self) -> Records:
        """`EPISODE` records of all completed training episodes, in order of completion, with their end step."""
        if self._env is None:
            return no_episodes()
        return self._env.finished_episodes()


class Method(ABC):
    """A way to obtain a policy. Parameters ride in the name: ``safety-guard:tc=5.0``.

    Attributes:
        name: Registered name.
        version: Raised by every change that alters results.
        trains: False for reference drivers, which have no T stage.
        bootstraps: False for learners that use no value of a next state (evolution, whole returns): to them truncation
            is no special case.
        bounds_cost: Whether it heeds the cost and its limit.
        defaults: Parameters and their default values; the type of the default is the parameter's type.
        setting_names: Keys that ``--set NAME.KEY=VALUE`` may carry.
    """

    name: ClassVar[str]
    version: ClassVar[int] = 1
    trains: ClassVar[bool] = True
    bootstraps: bool = True
    bounds_cost: bool = False
    defaults: ClassVar[Mapping[str, Any]] = {}
    setting_names: ClassVar[tuple[str, ...]] = ()

    def check_settings(self, settings: Mapping[str, str]) -> None:  # noqa: B027
        """Raise ValueError where a ``--set`` value cannot be used: called before anything runs."""

    def __init__(self, **parameters: Any) -> None:
        """Take parameters over the defaults.

        Raises:
            ValueError: A parameter is unknown.
        """
        unknown = sorted(set(parameters) - set(self.defaults))
        if unknown:
            raise ValueError(
                f"Method {self.name!r} has no parameter {unknown[0]!r}; it has: {sorted(self.defaults) or 'none'}."
            )
        self.parameters: Final[dict[str, Any]] = {**self.defaults, **parameters}

    @classmethod  # noqa: B027
    def check_available(cls) -> None:
        """Raise `algorithms.registry.UnavailableMethodError` where the method cannot be used."""

    @property
    def spec(self) -> str:
        """Canonical name with the parameters that differ from their defaults, for example ``safety-guard:tc=5.0``."""
        changed = [f"{k}={v}" for k, v in sorted(self.parameters.items()) if v != self.defaults[k]]
        return f"{self.name}:{','.join(changed)}" if changed else self.name

    @abstractmethod
    def train(self, task: Task) -> Policy:
        """Train within the task's budget and return the policy for application."""

    @abstractmethod
    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The policy that `Policy.save` wrote."""

"""What the contract's checks look at: small trainings on short episodes, and drives of a policy under observation."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from algorithms.atomic import files_below
from algorithms.method import Budget, Method, Policy, Task, seed_sequence
from bench.runner import GLOBAL, seed_global_generators
from envs.driving_env import ActionMode, DrivingVectorEnv, action_space
from envs.layout import EpisodeSource, held_out_source
from envs.observation import observation_bounds
from envs.scenario import GOAL_M, Scenario
from envs.world import BoolArray, FloatArray, Records, Shield, World

STEPS: Final = 4_000
"""Budget of a training, that of the smoke protocol."""
APPROACH_M: Final = 60.0
"""Training episodes start so far before the goal: many end there, truncated, within a small budget."""
WORLDS: Final = 16
DECISIONS: Final = 60
"""Length of a drive."""
BOUNDS_TOLERANCE: Final = 1e-6

StepResult = tuple[npt.NDArray[np.float32], FloatArray, BoolArray, BoolArray, dict[str, Any]]
Alter = Callable[[StepResult], StepResult]


class NearGoal(EpisodeSource):
    """The same episodes, begun shortly before the goal."""

    def chunk(self, index: int) -> World:
        """Episodes of a chunk, ego and traffic moved on along the road."""
        world = super().chunk(index)
        world.ego["s"] += GOAL_M - APPROACH_M
        world.vehicles["s"] += GOAL_M - APPROACH_M
        return world


@dataclass
class ProbeTask(Task):
    """A task on short episodes, whose steps may be altered on their way to the method.

    Attributes:
        alter: Changes what a step returns, or None.
        truncations: Episodes that were cut at the goal or the time limit so far.
    """

    alter: Alter | None = None
    truncations: int = 0

    def episodes(self) -> EpisodeSource:
        """Initial states of the training episodes."""
        return NearGoal(self.scenario, self.stream("train"))

    def make_env(
        self,
        worlds: int,
        shield: Shield | None = None,
        action_mode: ActionMode = ActionMode.ACCELERATION,
        comfort: bool = True,
    ) -> DrivingVectorEnv:
        """See `Task.make_env`."""
        env = super().make_env(worlds, shield, action_mode, comfort)
        original = env.step

        def step(actions: npt.NDArray[Any]) -> StepResult:
            result = original(actions)
            self.truncations += int(result[3].sum())
            return result if self.alter is None else self.alter(result)

        setattr(env, "step", step)  # noqa: B010  a spy; mypy forbids the plain assignment
        return env


def call_truncations_terminations(result: StepResult) -> StepResult:
    """The same step with every ending called a termination."""
    observations, rewards, terminated, truncated, info = result
    return observations, rewards, terminated | truncated, np.zeros_like(truncated), info


def forge_final_observations(result: StepResult) -> StepResult:
    """The same step with another last observation of each truncated episode."""
    observations, rewards, terminated, truncated, info = result
    if truncated.any():
        info["final_obs"][truncated] = 0.5
    return observations, rewards, terminated, truncated, info


def charge_every_step(result: StepResult) -> StepResult:
    """The same step at a cost of 1 in every world."""
    *rest, info = result
    return (*rest, {**info, "cost": np.ones_like(info["cost"])})  # type: ignore[return-value]


@dataclass(frozen=True, slots=True)
class Trial:
    """One training and what it left.

    Attributes:
        policy: The trained policy.
        files: What `Policy.save` wrote, by name.
        steps: Simulation steps that the training environment was driven.
        episodes: Its finished episodes.
        truncations: How many of them were truncated.
    """

    policy: Policy
    files: dict[str, bytes]
    steps: int
    episodes: Records
    truncations: int


def task_for(scenario: Scenario, cache: Path, alter: Alter | None = None) -> ProbeTask:
    """The task that every trial trains on."""
    return ProbeTask(scenario, 0, Budget(STEPS), cache=cache, alter=alter)


def trial(method: Method, scenario: Scenario, cache: Path, alter: Alter | None = None) -> Trial:
    """Train and save; whatever the method raises comes through."""
    task = task_for(scenario, cache, alter)
    seed_global_generators(task, GLOBAL)
    policy = method.train(task)
    with tempfile.TemporaryDirectory() as folder:
        policy.save(Path(folder))
        files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in files_below(Path(folder))}
    return Trial(policy, files, task.steps_done(), task.finished_episodes(), task.truncations)


class WatchedShield:
    """A shield, and every argument that it changed."""

    def __init__(self, shield: Shield, faults: list[str]) -> None:
        """Watch a shield; faults are added to the list."""
        self._shield = shield
        self._faults = faults

    def begin(self, seed: np.random.SeedSequence) -> None:
        """Passed on."""
        self._shield.begin(seed)

    def observe(self, observations: npt.NDArray[np.float32]) -> None:
        """Passed on."""
        before = observations.copy()
        self._shield.observe(observations)
        if not np.array_equal(before, observations):
            self._faults.append("observe() wrote into the observations: copy them first")

    def filter(
        self, world: World, targets: FloatArray, accelerations: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray | None]:
        """Passed on."""
        before = world.copy(), targets.copy(), accelerations.copy()
        answer = self._shield.filter(world, targets, accelerations)
        changed = [
            f"world.{name}"
            for name in ("ego", "vehicles", "pedestrians", "episode")
            if getattr(world, name).tobytes() != getattr(before[0], name).tobytes()
        ]
        changed += ["targets"] * (not np.array_equal(before[1], targets))
        changed += ["accelerations"] * (not np.array_equal(before[2], accelerations))
        self._faults += [f"filter() wrote into {name}: answer with new arrays" for name in changed]
        n = len(world)
        for name, value in zip(("targets", "accelerations", "intervened", "horizons"), answer, strict=True):
            shape = getattr(value, "shape", None)
            if shape != (n,) and not (name == "horizons" and value is None):
                self._faults.append(f"filter() answered with {name} of shape {shape}: must be ({n},)")
        return answer


@dataclass(slots=True)
class Drive:
    """What a policy did on the first decisions of held-out episodes.

    Attributes:
        actions: Every action, one after another.
        states: The egos after every decision, as bytes.
        infinite: Actions that were not finite.
        outside: Actions of a wrong shape or beyond the action space.
        written: Observations that `act` wrote into.
        shield: What the shield did to its arguments.
    """

    actions: list[npt.NDArray[Any]] = field(default_factory=list)
    states: list[bytes] = field(default_factory=list)
    infinite: list[str] = field(default_factory=list)
    outside: list[str] = field(default_factory=list)
    written: list[str] = field(default_factory=list)
    shield: list[str] = field(default_factory=list)

    def ask(self, policy: Policy, observations: npt.NDArray[np.float32], when: str) -> npt.NDArray[Any]:
        """The policy's action with its faults noted, and made harmless so that the drive can go on."""
        space = action_space(policy.action_mode)
        before = observations.copy()
        actions = np.array(policy.act(observations), np.float64)
        if not np.array_equal(before, observations):
            self.written.append(f"act() wrote into its observations {when}: copy them first")
            observations[:] = before
        expected = (len(observations), *space.shape)
        self.actions.append(actions)
        if actions.shape != expected:
            self.outside.append(f"act() gave shape {actions.shape} {when}: must be {expected} (worlds, action)")
            return np.zeros(expected)
        for world, entry in np.argwhere(~np.isfinite(actions))[:1]:
            self.infinite.append(f"act() gave {actions[world, entry]} as entry {entry} for world {world} {when}")
        beyond = (actions < space.low - BOUNDS_TOLERANCE) | (actions > space.high + BOUNDS_TOLERANCE)
        for world, entry in np.argwhere(beyond)[:1]:
            bounds = f"[{space.low[entry]:g}, {space.high[entry]:g}]"
            value = actions[world, entry]
            self.outside.append(f"act() gave {value:g} as entry {entry} for world {world} {when}: outside {bounds}")
        return np.clip(np.nan_to_num(actions), space.low, space.high)


def drive(policy: Policy, scenario: Scenario, found: Drive) -> None:
    """Drive a policy behind its shield, then ask it about single and about extreme observations."""
    shield = None if policy.shield is None else WatchedShield(policy.shield, found.shield)
    env = DrivingVectorEnv(
        scenario, WORLDS, shield=shield, action_mode=policy.action_mode, source=held_out_source(scenario, 10 * WORLDS)
    )
    observations, _ = env.reset()
    policy.begin(WORLDS, seed_sequence("contract", scenario.id))
    for decision in range(DECISIONS):
        observations = env.step(found.ask(policy, observations, f"at decision {decision}"))[0]
        found.states.append(env.world.ego.tobytes())
    low, high = observation_bounds()
    corners = np.stack([low, high, np.zeros_like(low)])
    policy.begin(len(corners), seed_sequence("contract", "corners"))
    found.ask(policy, corners, "at the bounds of the observation space")
    policy.begin(1, seed_sequence("contract", "one"))
    found.ask(policy, observations[:1].copy(), "for one world alone")

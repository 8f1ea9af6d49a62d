"""An episode recorded at every step of 0.1 s, for pictures and for what is drawn over them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from envs.driving_env import ActionMode, DrivingVectorEnv
from envs.layout import EpisodeSource
from envs.scenario import Scenario, get_scenario
from envs.world import BoolArray, FloatArray, Records, World

Act = Callable[[npt.NDArray[np.float32]], npt.NDArray[Any]]
"""Actions (1, A) in physical units for observations (1, 47)."""

_ARRAYS = ("ego", "vehicles", "pedestrians", "episode", "proposed", "executed", "intervened")


@dataclass(frozen=True, slots=True)
class EpisodeTrace:
    """One episode of T steps; entry 0 of the states is the start, entry t the end of step t.

    Attributes:
        scenario: What was driven.
        number: Episode number in its source.
        ego: `EGO` records, shape (T + 1,).
        vehicles: `VEHICLE` records, shape (T + 1, V).
        pedestrians: `PEDESTRIAN` records, shape (T + 1, P).
        episode: `EPISODE` records, shape (T + 1,): running totals; their differences are a step's rewards, cost.
        proposed: Lateral target [m] and acceleration [m/s2] that the policy asked for, shape (T, 2). In the
            driving agent's action mode no acceleration is asked for: NaN.
        executed: The same as carried out, shape (T, 2).
        intervened: Whether the shield flagged the step, shape (T,).

    Raises:
        ValueError: The lengths do not fit together.
    """

    scenario: Scenario
    number: int
    ego: Records
    vehicles: Records
    pedestrians: Records
    episode: Records
    proposed: FloatArray
    executed: FloatArray
    intervened: BoolArray

    def __post_init__(self) -> None:
        """Refuse arrays of different episodes."""
        lengths = {name: len(getattr(self, name)) for name in _ARRAYS}
        steps = lengths["intervened"]
        wrong = [f"{name}: {n}" for name, n in lengths.items() if n != steps + (name in _ARRAYS[:4])]
        if wrong:
            raise ValueError(f"A trace of {steps} steps has {steps + 1} states, {steps} actions; not {wrong}.")

    def __len__(self) -> int:
        """Number of steps T."""
        return len(self.intervened)

    def world(self, step: int) -> World:
        """The world after so many steps, 0 to T or negative from the end, as one row."""
        at = range(len(self) + 1)[step]
        rows = (states[at : at + 1] for states in (self.ego, self.vehicles, self.pedestrians, self.episode))
        return World(*rows)

    def save(self, path: Path) -> None:
        """Write a compressed npz file, without pickle."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        with path.open("wb") as file:
            name, version = self.scenario.name, self.scenario.version
            np.savez_compressed(file, scenario=name, version=version, number=self.number, **arrays)


def load_trace(path: Path) -> EpisodeTrace:
    """Read what `EpisodeTrace.save` wrote.

    Raises:
        ValueError: The trace is of another version of its scenario.
    """
    with np.load(path, allow_pickle=False) as file:
        scenario = get_scenario(str(file["scenario"]))
        if scenario.version != int(file["version"]):
            raise ValueError(f"{path.name} is of {scenario.name}-v{file['version']}; this is {scenario.id}.")
        return EpisodeTrace(scenario, int(file["number"]), **{name: file[name] for name in _ARRAYS})


@dataclass(slots=True)
class _Recorder:
    """Collects copies of the one world's state after every step."""

    planning: bool
    worlds: list[World] = field(default_factory=list)
    proposed: list[tuple[float, float]] = field(default_factory=list)
    intervened: list[bool] = field(default_factory=list)

    def __call__(self, world: World, targets: FloatArray, commands: FloatArray, intervened: BoolArray) -> None:
        """Add a step, unless the episode had ended before it."""
        if world.episode["steps"][0] == self.worlds[-1].episode["steps"][0]:
            return
        self.worlds.append(world.copy())
        self.proposed.append((float(targets[0]), np.nan if self.planning else float(commands[0])))
        self.intervened.append(bool(intervened[0]))

    def trace(self, scenario: Scenario, number: int) -> EpisodeTrace:
        names = ("ego", "vehicles", "pedestrians", "episode")
        states = {name: np.concatenate([getattr(w, name) for w in self.worlds]) for name in names}
        ego = states["ego"][1:]
        return EpisodeTrace(
            scenario,
            number,
            **states,
            proposed=np.array(self.proposed).reshape(-1, 2),
            executed=np.stack([ego["target_d"], ego["command"]], axis=1),
            intervened=np.array(self.intervened, np.bool_),
        )


def record_episode(source: EpisodeSource, number: int, act: Act, **arguments: Any) -> EpisodeTrace:
    """Drive one numbered episode to its end and keep every 0.1 s of it.

    Args:
        source: Numbered initial states, of the scenario to drive.
        number: Which of them.
        act: The policy: ``Policy.act`` after ``begin(1, seed)``, or any other callable.
        **arguments: Further arguments of `DrivingVectorEnv`: ``shield``, ``action_mode``, ``cost_signal``.

    Raises:
        ValueError: The source has no such episode.
    """
    if number < source.start or (source.stop is not None and number >= source.stop):
        raise ValueError(f"Episode {number}: the source has {source.start} to {source.stop}, exclusive.")
    only = dataclasses.replace(source, start=number, stop=number + 1)
    env = DrivingVectorEnv(source.scenario, 1, source=only, autoreset=False, **arguments)
    observations, _ = env.reset()
    recorder = _Recorder(env.action_mode is ActionMode.PLANNING, [env.world.copy()])
    env.on_substep = recorder
    while env.active[0]:
        observations = env.step(act(observations))[0]
    return recorder.trace(source.scenario, number)

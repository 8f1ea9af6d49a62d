"""An episode recorded at every step of 0.1 s, for pictures and for what is drawn over them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from envs.driving_env import ActionMode, DrivingVectorEnv
from envs.layout import CHUNK, EpisodeSource
from envs.scenario import Scenario, get_scenario
from envs.world import BoolArray, Ending, FloatArray, Records, World

Act = Callable[[npt.NDArray[np.float32]], npt.NDArray[Any]]
"""Actions (N, A) in physical units for observations (N, 47)."""

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
class Recorder:
    """Collects one episode at every step of 0.1 s: a hook for `DrivingVectorEnv.on_substep`.

    Attributes:
        row: The world that the episode runs in.
        start: Its initial state, one row, numbered in ``episode``.
        planning: Whether actions are the driving agent's, without an acceleration.
    """

    row: int
    start: World
    planning: bool = False
    worlds: list[World] = field(default_factory=list)
    proposed: list[tuple[float, float]] = field(default_factory=list)
    intervened: list[bool] = field(default_factory=list)

    @property
    def number(self) -> int:
        """Of the episode."""
        return int(self.start.episode["episode"][0])

    @property
    def ended(self) -> bool:
        """Whether the episode is over."""
        return bool(self.worlds) and bool(self.worlds[-1].episode["ending"][0] != Ending.RUNNING)

    def __call__(self, world: World, targets: FloatArray, commands: FloatArray, intervened: BoolArray) -> None:
        """Add a step, unless another episode runs in the world, or this one had ended before the step."""
        k = self.row
        if self.ended or world.episode["episode"][k] != self.number:
            return
        self.worlds.append(take_row(world, k))
        self.proposed.append((float(targets[k]), np.nan if self.planning else float(commands[k])))
        self.intervened.append(bool(intervened[k]))

    def trace(self, scenario: Scenario) -> EpisodeTrace:
        """What was collected."""
        names = ("ego", "vehicles", "pedestrians", "episode")
        states = {name: np.concatenate([getattr(w, name) for w in (self.start, *self.worlds)]) for name in names}
        ego = states["ego"][1:]
        return EpisodeTrace(
            scenario,
            self.number,
            **states,
            proposed=np.array(self.proposed).reshape(-1, 2),
            executed=np.stack([ego["target_d"], ego["command"]], axis=1),
            intervened=np.array(self.intervened, np.bool_),
        )


def take_row(world: World, row: int) -> World:
    """A copy of one of the worlds, as one row."""
    only = slice(row, row + 1)
    return World(
        world.ego[only].copy(), world.vehicles[only].copy(), world.pedestrians[only].copy(), world.episode[only].copy()
    )


def initial_state(source: EpisodeSource, number: int) -> World:
    """Initial state of a numbered episode, one row.

    Raises:
        ValueError: The source has no such episode.
    """
    if number < source.start or (source.stop is not None and number >= source.stop):
        raise ValueError(f"Episode {number}: the source has {source.start} to {source.stop}, exclusive.")
    return take_row(source.chunk(number // CHUNK), number % CHUNK)


@dataclass(slots=True)
class Seated(EpisodeSource):
    """Chosen episodes of a source, over and over, one to each world.

    Attributes:
        states: Their initial states, shape (n,).
    """

    states: World | None = None

    def chunk(self, index: int) -> World:
        """The chosen episodes, repeated to 1024 rows."""
        assert self.states is not None
        rows = np.arange(CHUNK) % len(self.states)
        chosen = self.states
        return World(chosen.ego[rows], chosen.vehicles[rows], chosen.pedestrians[rows], chosen.episode[rows])


def seat(source: EpisodeSource, numbers: Sequence[int], worlds: int) -> Seated:
    """A source that begins the chosen episodes in worlds 0, 1, ... and fills the others with the same again.

    Raises:
        ValueError: The source lacks an episode, or there are more of them than worlds.
    """
    if not 0 < len(numbers) <= worlds <= CHUNK:
        raise ValueError(f"{len(numbers)} episodes in {worlds} worlds: 1 to {CHUNK} worlds, one or more episodes.")
    states = [initial_state(source, number) for number in numbers]
    fields = ("ego", "vehicles", "pedestrians", "episode")
    together = World(*(np.concatenate([getattr(state, name) for state in states]) for name in fields))
    return Seated(source.scenario, source.seed, 0, worlds, together)


def record_rows(env: DrivingVectorEnv, source: EpisodeSource, seats: Mapping[int, int], act: Act) -> list[EpisodeTrace]:
    """Drive an environment until the wanted episodes have ended and keep every 0.1 s of them.

    Args:
        env: Not yet reset; how many worlds it has, and what runs in the others, may matter to the policy.
        source: Where the numbered initial states come from.
        seats: World by number of a wanted episode: where it is bound to run.
        act: The policy, for all worlds of the environment.

    Raises:
        ValueError: The source lacks an episode, or one did not run where it was expected.
    """
    planning = env.action_mode is ActionMode.PLANNING
    recorders = [Recorder(row, initial_state(source, number), planning) for number, row in seats.items()]

    def record(world: World, targets: FloatArray, commands: FloatArray, intervened: BoolArray) -> None:
        for recorder in recorders:
            recorder(world, targets, commands, intervened)

    env.on_substep = record
    observations, _ = env.reset()
    while env.active.any() and not all(recorder.ended for recorder in recorders):
        observations = env.step(act(observations))[0]
    for recorder in recorders:
        if not recorder.ended:
            raise ValueError(f"Episode {recorder.number} did not run in world {recorder.row}.")
    return [recorder.trace(source.scenario) for recorder in recorders]


def record_episode(source: EpisodeSource, number: int, act: Act, *, worlds: int = 1, **arguments: Any) -> EpisodeTrace:
    """Drive one numbered episode to its end and keep every 0.1 s of it.

    Args:
        source: Numbered initial states, of the scenario to drive.
        number: Which of them.
        act: The policy: ``Policy.act`` after ``begin(worlds, seed)``, or any other callable.
        worlds: Worlds that drive the same episode at the same time; the rounding of a network's products depends
            on it.
        **arguments: Further arguments of `DrivingVectorEnv`: ``shield``, ``action_mode``, ``cost_signal``.

    Raises:
        ValueError: The source has no such episode.
    """
    seated = seat(source, [number], worlds)
    env = DrivingVectorEnv(source.scenario, worlds, source=seated, autoreset=False, **arguments)
    return record_rows(env, source, {number: 0}, act)[0]

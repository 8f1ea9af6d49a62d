"""gymnasium's face of N worlds: `DrivingVectorEnv`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numba
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv

from envs import batch, engine
from envs.actions import action_space
from envs.episodes import EpisodeLog, EpisodeStream, masked_worlds, stream_seed
from envs.layout import EpisodeSource
from envs.observation import OBSERVATION_SIZE, observation_space
from envs.scenario import PedestrianRule, Scenario, get_scenario
from envs.shield_answer import check_answer
from envs.terms import ActionMode, BudgetExceededError, CostSignal, MutatedObservationError
from envs.world import EPISODE, BoolArray, FloatArray, Records, Shield, World, empty_world

__all__ = [
    "ActionMode", "BudgetExceededError", "CostSignal", "DrivingVectorEnv", "MutatedObservationError", "action_space",
]  # fmt: skip

SubstepHook = Callable[[World, FloatArray, FloatArray, npt.NDArray[np.bool_]], None]


class DrivingVectorEnv(VectorEnv[npt.NDArray[np.float32], npt.NDArray[Any], npt.NDArray[Any]]):
    """N worlds stepped together by the compiled engine.

    One step is one decision: the action is held for ``scenario.substeps`` steps of 0.1 s, the reward is their
    sum divided by that number, the cost their sum. Autoreset mode is SAME_STEP: a finished world starts its
    next episode in the step that ends it; ``info["final_obs"]`` holds the last observation of the old one.

    ``info`` of a step, each of shape (N,): ``cost``, ``reward_without_risk``, ``intervened`` (steps of this
    decision that the shield flagged); with finished worlds also ``final_obs`` (N, 47), its mask ``_final_obs``
    and ``finished``, their `EPISODE` records in order of world.

    Args:
        scenario: The constrained MDP, or its name.
        num_envs: N, at least 1.
        shield: Filters every action at every 0.1 s step, or None.
        action_mode: What actions mean.
        comfort: Whether the reward includes r_cf (the driving agent's does not).
        cost_signal: What costs 1.
        source: Numbered initial states; by default an endless stream from the seed of `reset`.
        decision_limit: Steps of this environment allowed in all, or None.
        threads: Threads for the worlds; results do not depend on it.
        autoreset: False leaves finished worlds ended until `reset` (mode DISABLED).
        watched: Refuse to go on once somebody has written into the observations of the last step.

    Attributes:
        on_substep: Called after every 0.1 s step with the worlds, the proposed targets (N,) [m] and
            accelerations (N,) [m/s2] and the shield's flags (N,), or None. Must not change them. Worlds that
            have ended stand still.

    Raises:
        ValueError: ``num_envs`` or ``threads`` is below 1.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        scenario: Scenario | str,
        num_envs: int,
        *,
        shield: Shield | None = None,
        action_mode: ActionMode = ActionMode.ACCELERATION,
        comfort: bool = True,
        cost_signal: CostSignal = CostSignal.COLLISION,
        source: EpisodeSource | None = None,
        decision_limit: int | None = None,
        threads: int = 1,
        autoreset: bool = True,
        watched: bool = False,
    ) -> None:
        """Allocate the worlds; the first episodes begin with `reset`."""
        if num_envs < 1 or threads < 1:
            raise ValueError(f"num_envs = {num_envs}, threads = {threads}: both must be at least 1.")
        scenario = get_scenario(scenario) if isinstance(scenario, str) else scenario
        self.scenario = scenario
        self.num_envs = num_envs
        self.shield = shield
        self.on_substep: SubstepHook | None = None
        self.action_mode = action_mode
        self.metadata = {
            **self.metadata,
            "autoreset_mode": AutoresetMode.SAME_STEP if autoreset else AutoresetMode.DISABLED,
        }
        self.single_observation_space = observation_space()
        self.single_action_space = action_space(action_mode)
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)
        self.world = empty_world(num_envs, scenario.vehicles, scenario.pedestrians)
        self.active = np.zeros(num_envs, np.bool_)
        self.decisions = 0
        self._comfort = comfort
        self._cost_signal = int(cost_signal)
        self.decision_limit = decision_limit
        self._threads = threads
        self._advance_worlds = engine.advance if threads == 1 else engine.advance_parallel
        self._observe_worlds = batch.observe if threads == 1 else batch.observe_parallel
        self._autoreset = autoreset
        self._watched = watched
        self._given: npt.NDArray[np.float32] | None = None
        self._stream = EpisodeStream(scenario, source)
        self._log = EpisodeLog()
        self._observations = np.zeros((num_envs, OBSERVATION_SIZE), np.float32)
        self._fair = scenario.pedestrian_rule is PedestrianRule.FAIR
        self._planning = action_mode is ActionMode.PLANNING
        self._all = np.arange(num_envs)
        self._quiet = np.zeros(num_envs, np.bool_)
        self._interventions = np.zeros(num_envs, np.int64)
        self._sums = np.zeros((num_envs, 4))
        self._targets, self._commands, self._horizons, self._speeds = np.zeros((4, num_envs))
        self._low = np.asarray(self.single_action_space.low, np.float64)
        self._high = np.asarray(self.single_action_space.high, np.float64)

    @property
    def steps_done(self) -> int:
        """Simulation steps of 0.1 s so far, over all worlds."""
        return self.decisions * self.num_envs * self.scenario.substeps

    def finished_episodes(self) -> Records:
        """All episodes that have ended, in order of completion, `EPISODE` records."""
        return self._log.all()

    @property
    def episodes_done(self) -> int:
        """Number of episodes that have ended."""
        return len(self._log)

    def recent_episodes(self, count: int) -> Records:
        """The last so many finished episodes, `EPISODE` records."""
        return self._log.last(count)

    def snapshot(self) -> dict[str, npt.NDArray[Any]]:
        """What later steps depend on, the shield apart: copies, for `restore`."""
        kept = {name: values.copy() for name, values in self._kept().items()}
        counters = np.array([self.decisions, self._stream.next_episode])
        return {**kept, "counters": counters, "finished": self.finished_episodes()}

    def restore(self, kept: Mapping[str, npt.NDArray[Any]]) -> None:
        """Go on from the `snapshot` of an environment that was made with the same arguments and source.

        Raises:
            ValueError: The worlds or their bodies are of another number.
        """
        for name, values in self._kept().items():
            if kept[name].shape != values.shape:
                raise ValueError(f"{name} has shape {kept[name].shape}; this environment needs {values.shape}.")
            values[...] = kept[name]
        self.decisions, next_episode = map(int, kept["counters"])
        self._stream.go_on_from(next_episode)
        self._log.replace(kept["finished"].astype(EPISODE))
        self._given = None

    def _kept(self) -> dict[str, npt.NDArray[Any]]:
        world = self.world
        names = ("ego", "vehicles", "pedestrians", "episode", "active", "interventions", "observations")
        bodies = world.ego, world.vehicles, world.pedestrians, world.episode
        return dict(zip(names, (*bodies, self.active, self._interventions, self._observations), strict=True))

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        """Start a new episode in every world; a seed starts the stream of episodes, or the given source, anew.

        Args:
            seed: An integer or one for each world: the name of the one stream of all worlds. None goes on in it.
            options: ``{"reset_mask": mask}``, bool (N,), restarts these worlds only; needs ``autoreset=False``.

        Raises:
            TypeError, ValueError: See `envs.episodes.masked_worlds` and `envs.episodes.stream_seed`.
        """
        worlds = self._all
        if options is not None and "reset_mask" in options:
            worlds = masked_worlds(options["reset_mask"], self.num_envs, self._autoreset)
        self._stream.restart(stream_seed(seed, self.num_envs))
        self.active[worlds] = False
        self._stream.begin(worlds, self.world, self.active, self._interventions)
        self._observe(worlds)
        return self._give(), {}

    def step(
        self, actions: npt.NDArray[Any]
    ) -> tuple[npt.NDArray[np.float32], FloatArray, npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """Carry out one decision in every world.

        Args:
            actions: Shape (N, A), physical units; values beyond the action space are clipped to it.

        Raises:
            ValueError: Wrong shape, or an unusable value, from policy or shield (`envs.shield_answer`).
            BudgetExceededError: The decision limit is used up.
            MutatedObservationError: The environment is watched, and its last observations were written into.
        """
        if self._given is not None and not np.array_equal(self._given, self._observations):
            raise MutatedObservationError("The observations of the last step were written into: copy them first.")
        if self._threads > 1:
            numba.set_num_threads(self._threads)
        self._interpret(actions)
        if self.decision_limit is not None and self.decisions >= self.decision_limit:
            raise BudgetExceededError(f"The budget of {self.decision_limit} decisions per world is used up.")
        self.decisions += 1
        self._sums[:] = 0.0
        self._drive()
        n = self.num_envs
        reward, without_risk, cost = np.empty(n), np.empty(n), np.empty(n)
        terminated, truncated = np.empty(n, np.bool_), np.empty(n, np.bool_)
        intervened = np.empty(n, np.int64)
        ended = batch.conclude(
            self.world.episode, self.active, self._interventions, self._sums, self.scenario.substeps, self._comfort,
            reward, without_risk, cost, intervened, terminated, truncated,
        )  # fmt: skip
        info: dict[str, Any] = {"cost": cost, "reward_without_risk": without_risk, "intervened": intervened}
        self._observe(self._all)
        if ended:
            done = terminated | truncated
            info |= {"final_obs": self._observations.copy(), "_final_obs": done, "finished": self._finish(done)}
        return self._give(), reward, terminated, truncated, info

    def _give(self) -> npt.NDArray[np.float32]:
        """A copy of the observations, kept in sight where the environment is watched."""
        given = self._observations.copy()
        if self._watched:
            self._given = given
        return given

    def _interpret(self, actions: npt.NDArray[Any]) -> None:
        """Check actions and keep what they ask for."""
        values = np.ascontiguousarray(actions, np.float64)
        expected = (self.num_envs, len(self._low))
        if values.shape != expected:
            raise ValueError(f"Actions have shape {values.shape}; expected {expected} (worlds, action).")
        bad = batch.interpret_actions(
            self.world.ego, values, self._low, self._high, self._planning,
            self._targets, self._commands, self._horizons, self._speeds,
        )  # fmt: skip
        if bad != batch.VALID:
            world, entry = divmod(bad, len(self._low))
            raise ValueError(f"Action entry {entry} of world {world} is {values[world, entry]}: must be finite.")

    def _drive(self) -> None:
        """Hold the actions for one decision."""
        targets, commands, quiet = self._targets, self._commands, self._quiet
        if self.shield is None and self.on_substep is None:
            self._advance(targets, commands, quiet, self._horizons, self.scenario.substeps)
            return
        if self.shield is not None:
            self.shield.observe(self._observations)
        safe_targets, safe_commands, intervened, horizons = targets, commands, quiet, self._horizons
        for _ in range(self.scenario.substeps):
            if self.shield is not None:
                safe_targets, safe_commands, intervened, wanted = self.shield.filter(self.world, targets, commands)
                horizons = self._horizons if wanted is None else wanted
                check_answer(self.shield, self.world, safe_targets, safe_commands, intervened, horizons)
            self._advance(safe_targets, safe_commands, intervened, horizons, 1)
            if self.on_substep is not None:
                self.on_substep(self.world, targets, commands, intervened)

    def _advance(
        self, targets: FloatArray, commands: FloatArray, intervened: BoolArray, horizons: FloatArray, substeps: int
    ) -> None:
        """Some steps of 0.1 s under executed actions, which may differ from the proposed ones."""
        world = self.world
        self._advance_worlds(
            world.ego, world.vehicles, world.pedestrians, world.episode, targets, commands, horizons, self._speeds,
            self._targets, self._commands, intervened, substeps,
            self._planning, self.scenario.lane_changes, self._fair, self._cost_signal, self._sums,
        )  # fmt: skip

    def _observe(self, worlds: npt.NDArray[np.int64]) -> None:
        world = self.world
        self._observe_worlds(world.ego, world.vehicles, world.pedestrians, self.active, worlds, self._observations)

    def _finish(self, done: BoolArray) -> Records:
        """Keep the records of finished worlds and begin their next episodes."""
        worlds = np.flatnonzero(done)
        records: Records = self.world.episode[worlds]
        records["world"] = worlds
        records["end_step"] = self.steps_done
        self._log.add(records)
        self.active[worlds] = False
        if self._autoreset:
            self._stream.begin(worlds, self.world, self.active, self._interventions)
            self._observe(worlds)
        return records

"""Soft actor-critic by stable-baselines3, with the paper's networks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Final

import torch
from stable_baselines3 import SAC as StableBaselinesSAC
from stable_baselines3.common.callbacks import BaseCallback

from algorithms.fast_sac import FastSAC, HalfFastSAC, reproducible
from algorithms.guard_features import GuardFeatures
from algorithms.method import Method, Policy, Task
from algorithms.networks import Architecture, NetworkPolicy, copy_linear_layers
from algorithms.sac_checkpoint import Checkpointing, restore
from algorithms.sb3_env import StableBaselinesEnv
from envs.driving_env import ActionMode, DrivingVectorEnv
from envs.world import Ending, Shield

ACTOR_LAYERS: Final = (256, 256, 256, 256)
CRITIC_LAYERS: Final = (256, 256, 256)
"""Hidden layers (paper, appendix)."""
LEARNER_VERSION: Final = 2
"""Raised by every change of learner, constants or `SACSettings` that alters results; part of each version that rests
on it."""
GAMMA_PER_STEP: Final = 0.99
"""Discount per 0.1 s (paper, appendix); per decision it is raised to the number of steps."""


@dataclass(frozen=True, slots=True)
class SACSettings:
    """Settings of the learner, the same for every method that is SAC inside.

    Attributes:
        worlds: Worlds stepped together.
        decisions_per_update: Inverse update-to-data ratio; docs/performance.md has the evidence for it and for batch.
        batch: Transitions per update.
        warm_up: Decisions under uniformly random actions before learning starts.
        learning_rate: Adam's, of actor, critics and temperature (paper, appendix).
        tau: Target network step (paper, appendix).
        learner: ``fast``; ``sb3`` for the stock update (the same numbers, slower); ``bf16`` for bfloat16 products.
    """

    worlds: int = 16
    decisions_per_update: int = 4
    batch: int = 64
    warm_up: int = 1600
    learning_rate: float = 3e-4
    tau: float = 5e-3
    learner: str = "fast"

    def __post_init__(self) -> None:
        """Refuse values that cannot train."""
        for name, least in (("worlds", 1), ("decisions_per_update", 1), ("batch", 1), ("warm_up", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} = {getattr(self, name)}: must be at least {least}.")
        if not 0.0 < self.learning_rate < math.inf:
            raise ValueError(f"learning_rate = {self.learning_rate}: must be positive and finite.")
        if not 0.0 < self.tau <= 1.0:
            raise ValueError(f"tau = {self.tau}: must be above 0 and at most 1.")
        if self.learner not in LEARNERS:
            raise ValueError(f"learner = {self.learner!r}: must be one of {', '.join(LEARNERS)}.")
        if self.worlds % self.decisions_per_update and self.decisions_per_update % self.worlds:
            raise ValueError(
                f"decisions_per_update = {self.decisions_per_update}: must divide worlds = {self.worlds} or be a "
                "multiple of it."
            )

    @classmethod
    def from_settings(cls, settings: Mapping[str, str]) -> SACSettings:
        """Defaults with ``--set`` values over them.

        Raises:
            ValueError: A value is malformed.
        """
        changes: dict[str, Any] = {}
        for item in fields(cls):
            if item.name in settings:
                kind: Any = type(item.default)
                try:
                    changes[item.name] = kind(settings[item.name])
                except ValueError:
                    raise ValueError(f"{item.name} = {settings[item.name]!r}: expected {kind.__name__}.") from None
        return replace(cls(), **changes)

    @classmethod
    def for_task(cls, task: Task) -> SACSettings:
        """Settings of a task, held against its budget: an update comes after a whole roll-out.

        Raises:
            ValueError: A value is malformed, or the last roll-out would go beyond the budget.
        """
        chosen, steps = cls.from_settings(task.settings), task.budget.steps
        every = chosen.decisions_per_update
        if every > chosen.worlds and task.budget.decisions(task.scenario) % every:
            unit = every * task.scenario.substeps
            near = max(1, round(steps / unit)) * unit
            raise ValueError(
                f"steps = {steps} with decisions_per_update = {every}: must be a multiple of {unit}; nearest: {near}. "
                f"Or take decisions_per_update = {chosen.worlds}, one update for every decision of the worlds."
            )
        return chosen


LEARNERS: Final[dict[str, type[StableBaselinesSAC]]] = {
    "fast": FastSAC, "bf16": HalfFastSAC, "sb3": StableBaselinesSAC,
}  # fmt: skip
SETTING_NAMES: Final = tuple(item.name for item in fields(SACSettings))


class _Progress(BaseCallback):
    """Reports steps, learner scalars and the running collision rate; stops on numbers that are not finite."""

    def __init__(self, task: Task, env: DrivingVectorEnv) -> None:
        super().__init__()
        self._task = task
        self._env = env
        self._every = max(1, 50_000 // (env.num_envs * env.scenario.substeps * 10))

    def _on_step(self) -> bool:
        if self._env.decisions % self._every == 0 or self._env.decisions == self._env.decision_limit:
            scalars = training_scalars(self._env)
            for key in ("actor_loss", "critic_loss", "ent_coef"):
                value = self.logger.name_to_value.get(f"train/{key}")
                if value is not None:
                    scalars[key] = float(value)
                    if not math.isfinite(scalars[key]):
                        raise FloatingPointError(f"{key} is {value} at simulation step {self._env.steps_done}.")
            self._task.progress(self._env.steps_done, scalars)
        return True


def training_scalars(env: DrivingVectorEnv, last: int = 100) -> dict[str, float]:
    """Means over the last finished episodes: return without r_risk, collision rate, speed, intervention ratio."""
    recent = env.recent_episodes(last)
    if not len(recent):
        return {}
    steps = recent["steps"].sum()
    return {
        "return": float((recent["return_driving"] + recent["return_comfort"]).mean()),
        "collision_rate": float((recent["ending"] == Ending.COLLISION).mean()),
        "speed_mps": float((recent["distance"] / (0.1 * recent["steps"])).mean()),
        "intervention_ratio": float(recent["interventions"].sum() / steps),
        "episodes": float(env.episodes_done),
    }


def train_sac(
    task: Task,
    shield: Shield | None = None,
    action_mode: ActionMode = ActionMode.ACCELERATION,
    comfort: bool = True,
    features: GuardFeatures | None = None,
) -> NetworkPolicy:
    """Train SAC within the task's budget and return its deterministic policy behind the same shield.

    The replay buffer holds the proposed action with the reward of what the shield made of it, r_risk included.
    Where features are given, networks and replay buffer hold observations with the features appended.
    A training that was killed goes on from the task's last checkpoint, to the same result.
    """
    torch.set_num_threads(1)
    chosen = SACSettings.for_task(task)
    env = task.make_env(chosen.worlds, shield, action_mode, comfort)
    decisions = task.budget.decisions(task.scenario)
    with reproducible(task.torch_seed()):
        model = LEARNERS[chosen.learner](
            "MlpPolicy",
            StableBaselinesEnv(env, features),
            learning_rate=chosen.learning_rate,
            buffer_size=decisions,
            learning_starts=min(chosen.warm_up, decisions // 2),
            batch_size=chosen.batch,
            tau=chosen.tau,
            gamma=GAMMA_PER_STEP**task.scenario.substeps,
            train_freq=max(1, chosen.decisions_per_update // chosen.worlds),
            gradient_steps=max(1, chosen.worlds // chosen.decisions_per_update),
            policy_kwargs={"net_arch": {"pi": list(ACTOR_LAYERS), "qf": list(CRITIC_LAYERS)}},
            seed=task.torch_seed(),
            device="cpu",
        )
        before = task.checkpoints.load()
        if before is not None:
            restore(model, env, before)
        callbacks: list[BaseCallback] = [_Progress(task, env), Checkpointing(task.checkpoints, env, before)]
        model.learn(decisions - model.num_timesteps, callbacks, reset_num_timesteps=before is None)
    return deterministic_policy(model, action_mode, shield, features)


def deterministic_policy(
    model: StableBaselinesSAC, action_mode: ActionMode, shield: Shield | None, features: GuardFeatures | None
) -> NetworkPolicy:
    """The mean of a trained actor as a policy that saves without pickle."""
    actor: Any = model.actor
    layers = [module for module in actor.latent_pi if isinstance(module, torch.nn.Linear)] + [actor.mu]
    architecture = Architecture((layers[0].in_features, *ACTOR_LAYERS, actor.mu.out_features), "relu", squashed=True)
    network = architecture.build()
    copy_linear_layers(layers, network)
    return NetworkPolicy(architecture, network, action_mode, shield, features)


class SAC(Method):
    """Plain SAC without a guard, the model-free baseline."""

    version = LEARNER_VERSION
    defaults: ClassVar[dict[str, Any]] = {}
    setting_names = SETTING_NAMES

    def check_settings(self, settings: Mapping[str, str]) -> None:
        """Refuse what the learner cannot use."""
        SACSettings.from_settings(settings)

    def train(self, task: Task) -> Policy:
        """Train on the environment's reward."""
        return train_sac(task)

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The saved actor."""
        return NetworkPolicy.load(folder)

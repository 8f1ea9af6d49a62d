"""A training of soft actor-critic by stable-baselines3, with the paper's networks."""

from __future__ import annotations

import math
from typing import Any, Final

import torch
from stable_baselines3 import SAC as StableBaselinesSAC
from stable_baselines3.common.callbacks import BaseCallback

from algorithms.fast_sac import FastSAC, HalfFastSAC, reproducible
from algorithms.guard_features import GuardFeatures
from algorithms.method import Task
from algorithms.networks import Architecture, NetworkPolicy, copy_linear_layers
from algorithms.sac import ACTOR_LAYERS, CRITIC_LAYERS, GAMMA_PER_STEP, SACSettings
from algorithms.sac_checkpoint import Checkpointing, restore
from algorithms.sb3_env import StableBaselinesEnv
from envs.driving_env import ActionMode, DrivingVectorEnv
from envs.world import Ending, Shield

LEARNER_CLASSES: Final[dict[str, type[StableBaselinesSAC]]] = {
    "fast": FastSAC, "bf16": HalfFastSAC, "sb3": StableBaselinesSAC,
}  # fmt: skip


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
        model = LEARNER_CLASSES[chosen.learner](
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

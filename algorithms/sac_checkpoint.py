"""Checkpoint and resume inside a training of stable-baselines3's SAC, to the same bytes.

Taken between two roll-outs, right after an update: no transition is half stored there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback

from algorithms.checkpoints import Array, Checkpoints, State
from algorithms.resuming import (
    environment,
    generators,
    optimizers,
    restore_environment,
    restore_generators,
    restore_optimizers,
)
from envs.driving_env import DrivingVectorEnv

COUNTERS: Final = ("num_timesteps", "_n_updates", "_episode_num")
STOCK_BUFFER: Final = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def capture(model: SAC, env: DrivingVectorEnv) -> State:
    """The state of a training between two roll-outs."""
    return State.joined(
        "between two roll-outs",
        learner=_learner(model),
        optimizers=optimizers(_optimizers(model)),
        replay=_replay(model),
        environment=environment(env),
        generators=generators(),
    )


def restore(model: SAC, env: DrivingVectorEnv, state: State) -> None:
    """Put a new learner, made with the same arguments, where the other one was."""
    _restore_learner(model, state.part("learner"))
    restore_optimizers(_optimizers(model), state.part("optimizers"))
    _restore_replay(model, state.part("replay"))
    restore_environment(env, state.part("environment"))
    restore_generators(state.part("generators"))


class Checkpointing(BaseCallback):
    """Saves the state where a checkpoint is due; gives the logger its numbers back after a resume."""

    def __init__(self, checkpoints: Checkpoints, env: DrivingVectorEnv, resumed: State | None) -> None:
        super().__init__()
        self._checkpoints = checkpoints
        self._env = env
        self._logged: Mapping[str, float] = {} if resumed is None else resumed.part("learner").values["logged"]

    def _on_training_start(self) -> None:
        for key, value in self._logged.items():
            self.logger.record(key, value)

    def _on_rollout_start(self) -> None:
        if self._checkpoints.due(self._env.steps_done):
            assert isinstance(self.model, SAC)
            self._checkpoints.save(self._env.steps_done, capture(self.model, self._env))

    def _on_step(self) -> bool:
        return True


def _optimizers(model: SAC) -> dict[str, torch.optim.Optimizer]:
    assert model.ent_coef_optimizer is not None
    return {"actor": model.actor.optimizer, "critic": model.critic.optimizer, "ent_coef": model.ent_coef_optimizer}


def _learner(model: SAC) -> State:
    assert model.log_ent_coef is not None
    arrays: dict[str, Array] = {f"policy.{k}": _numpy(v) for k, v in model.policy.state_dict().items()}
    arrays["log_ent_coef"] = _numpy(model.log_ent_coef)
    arrays["last_obs"] = np.asarray(model._last_obs)
    values: dict[str, Any] = {name: getattr(model, name) for name in COUNTERS}
    values["logged"] = {k: float(v) for k, v in model.logger.name_to_value.items() if k.startswith("train/")}
    # Actions of the warm-up come from the space's own generator.
    values["action_space"] = model.action_space.np_random.bit_generator.state
    return State(arrays, values=values)


def _restore_learner(model: SAC, state: State) -> None:
    assert model.log_ent_coef is not None
    tensors = {name: torch.from_numpy(values.copy()) for name, values in state.arrays.items()}
    model.policy.load_state_dict({k.removeprefix("policy."): v for k, v in tensors.items() if k.startswith("policy.")})
    with torch.no_grad():
        model.log_ent_coef.copy_(tensors["log_ent_coef"])
    model._last_obs = state.arrays["last_obs"].copy()
    for name in COUNTERS:
        setattr(model, name, state.values[name])
    model.action_space.np_random.bit_generator.state = state.values["action_space"]


def _numpy(tensor: torch.Tensor) -> Array:
    values: Array = tensor.detach().numpy()
    return values


def _buffer_arrays(buffer: Any) -> dict[str, Array]:
    """What a replay buffer holds, time first: one array of ours, or the five of stable-baselines3."""
    names = ("rows",) if hasattr(buffer, "rows") else STOCK_BUFFER
    return {name: getattr(buffer, name) for name in names}


def _replay(model: SAC) -> State:
    """Rows so far: the buffer holds the whole budget, so that no row is ever overwritten before the end."""
    buffer = model.replay_buffer
    assert buffer is not None
    length = buffer.buffer_size if buffer.full else buffer.pos
    rows = {name: values[:length] for name, values in _buffer_arrays(buffer).items()}
    return State(growing=rows, values={"pos": buffer.pos, "full": buffer.full})


def _restore_replay(model: SAC, state: State) -> None:
    buffer = model.replay_buffer
    assert buffer is not None
    for name, values in _buffer_arrays(buffer).items():
        values[: len(state.growing[name])] = state.growing[name]
    buffer.pos, buffer.full = state.values["pos"], state.values["full"]

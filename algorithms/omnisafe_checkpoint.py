"""Checkpoint and resume of an OmniSafe training, at the end of an epoch: it cannot go on in the middle of one.

There the buffer is empty, so that networks, optimisers, multiplier, cost window, worlds and generators are all.
"""

from __future__ import annotations

from collections import deque
from typing import Any, Final

import torch

from algorithms.checkpoints import State
from algorithms.omnisafe_env import VectorCMDP
from algorithms.resuming import (
    environment,
    generators,
    optimizers,
    restore_environment,
    restore_generators,
    restore_optimizers,
)
from envs.driving_env import DrivingVectorEnv

WINDOWS: Final = ("Metrics/EpRet", "Metrics/EpCost", "Metrics/EpLen")
"""What the logger keeps from one epoch to the next; the multiplier follows the second."""


def capture(trainer: Any, vector: DrivingVectorEnv) -> State:
    """The state of a training at the start of an epoch."""
    networks = {name: tensor.numpy() for name, tensor in trainer._actor_critic.state_dict().items()}
    logger, scheduler = trainer.logger, getattr(trainer._actor_critic, "actor_scheduler", None)
    values = {
        "epoch": logger.current_epoch,
        "windows": {name: list(logger._data[name]) for name in WINDOWS},
        "scheduler": None if scheduler is None else scheduler.state_dict(),
        "multiplier": _numbers(getattr(trainer, "_lagrange", None)),
    }
    return State.joined(
        "at the end of an epoch",
        learner=State(networks, values=values),
        optimizers=optimizers(_optimizers(trainer)),
        running=State(_adapter(trainer).snapshot()),
        environment=environment(vector),
        generators=generators(),
    )


def restore(trainer: Any, vector: DrivingVectorEnv, state: State) -> None:
    """Put a new training, made with the same arguments, at the start of the epoch where the other one was."""
    learner = state.part("learner")
    trainer._actor_critic.load_state_dict({k: torch.from_numpy(v.copy()) for k, v in learner.arrays.items()})
    restore_optimizers(_optimizers(trainer), state.part("optimizers"))
    if learner.values["scheduler"] is not None:
        trainer._actor_critic.actor_scheduler.load_state_dict(learner.values["scheduler"])
    _restore_numbers(getattr(trainer, "_lagrange", None), learner.values["multiplier"])
    for name in WINDOWS:
        trainer.logger._data[name].extend(learner.values["windows"][name])
    _skip_epochs(trainer, learner.values["epoch"])
    _adapter(trainer).restore(state.part("running").arrays)
    restore_environment(vector, state.part("environment"))
    restore_generators(state.part("generators"))


def _skip_epochs(trainer: Any, done: int) -> None:
    """Let `learn` do what is left; exploration noise goes by the number of the epoch."""
    trainer.logger._epoch = done
    trainer._cfgs.train_cfgs.epochs -= done
    annealing = trainer._actor_critic.annealing
    trainer._actor_critic.annealing = lambda epoch: annealing(done + epoch)


def _adapter(trainer: Any) -> VectorCMDP:
    """Our environment below OmniSafe's wrappers."""
    found = trainer._env
    while not isinstance(found, VectorCMDP):
        found = found._env
    return found


def _optimizers(trainer: Any) -> dict[str, torch.optim.Optimizer]:
    owners = {"networks": trainer._actor_critic, "multiplier": getattr(trainer, "_lagrange", None)}
    return {
        f"{owner}.{name}": value
        for owner, held in owners.items()
        if held is not None
        for name, value in vars(held).items()
        if isinstance(value, torch.optim.Optimizer)
    }


def _numbers(multiplier: Any) -> dict[str, Any]:
    """Numbers of a Lagrange multiplier, or of its PID controller."""
    found: dict[str, Any] = {}
    for name, value in ({} if multiplier is None else vars(multiplier)).items():
        if isinstance(value, torch.nn.Parameter):
            found[name] = value.item()
        elif isinstance(value, deque):
            found[name] = list(value)
        elif isinstance(value, (int, float)):
            found[name] = value
    return found


def _restore_numbers(multiplier: Any, numbers: dict[str, Any]) -> None:
    for name, value in numbers.items():
        held = getattr(multiplier, name)
        if isinstance(held, torch.nn.Parameter):
            held.data.fill_(value)
        elif isinstance(held, deque):
            held.clear()
            held.extend(value)
        else:
            setattr(multiplier, name, value)

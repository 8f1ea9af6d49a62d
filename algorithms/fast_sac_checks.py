"""What stable-baselines3's SAC takes and `FastSAC` has no update for: refused by name, never ignored."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, cast

from gymnasium import spaces
from stable_baselines3 import SAC
from torch import nn

from algorithms.packed_replay import PackedReplayBuffer


def _refusal(learner: SAC, what: str) -> ValueError:
    return ValueError(f"{type(learner).__name__} has no {what}: use stable_baselines3.SAC for that")


def _vector_length(space: spaces.Space[Any]) -> int | None:
    shape = space.shape if isinstance(space, spaces.Box) else None
    return shape[0] if shape is not None and len(shape) == 1 else None


def refuse_other_updates(learner: SAC) -> None:
    """Check the arguments, before the networks are made.

    Raises:
        ValueError: One of them asks for another update.
    """
    networks = {name: value for name, value in learner.policy_kwargs.items() if name not in ("net_arch", "use_sde")}
    replay = learner.replay_buffer_class
    refused = {
        f"observations of {learner.observation_space}": _vector_length(learner.observation_space) is None,
        f"actions of {learner.action_space}": _vector_length(learner.action_space) is None,
        f"ent_coef={learner.ent_coef}": not str(learner.ent_coef).startswith("auto"),
        f"target_update_interval={learner.target_update_interval}": learner.target_update_interval != 1,
        f"n_steps={learner.n_steps}": learner.n_steps != 1,
        "use_sde": learner.use_sde,
        f"replay_buffer_class={replay}": replay not in (None, PackedReplayBuffer),
        f"replay_buffer_kwargs={learner.replay_buffer_kwargs}": bool(learner.replay_buffer_kwargs),
        "optimize_memory_usage": learner.optimize_memory_usage,
        f"policy_kwargs {networks}": bool(networks),
        "a VecNormalize environment": learner._vec_normalize_env is not None,
    }
    for what, asked in refused.items():
        if asked:
            raise _refusal(learner, what)


def refuse_other_networks(learner: SAC) -> None:
    """Check the networks, which a policy class of one's own may have made.

    Raises:
        ValueError: They are no ReLU perceptrons, or the actor has no hidden layer.
    """
    networks = [cast(Iterable[nn.Module], network) for network in (learner.actor.latent_pi, *learner.critic.q_networks)]
    for layer in (layer for network in networks for layer in network):
        if not isinstance(layer, nn.Linear | nn.ReLU):
            raise _refusal(learner, type(layer).__name__)
    if not list(networks[0]):
        raise _refusal(learner, f"actor without hidden layers (net_arch {learner.actor.net_arch})")


def checked_replay(learner: SAC) -> PackedReplayBuffer:
    """The replay buffer, if the update can read it: it and the environment may be others than at the start.

    Raises:
        ValueError: It is of another kind or width, or the environment normalises.
    """
    buffer = learner.replay_buffer
    if not isinstance(buffer, PackedReplayBuffer):
        raise _refusal(learner, type(buffer).__name__)
    if learner._vec_normalize_env is not None:
        raise _refusal(learner, "VecNormalize environment")
    n, a = _vector_length(learner.observation_space), _vector_length(learner.action_space)
    assert n is not None
    assert a is not None
    if buffer.transitions.shape[1] != 2 * n + a + 2:
        raise ValueError(
            f"rows of the replay buffer have {buffer.transitions.shape[1]} entries, not 2 x {n} + {a} + 2: it was "
            "filled in another environment"
        )
    return buffer

"""States that learners share: optimisers, generators of the process, a training environment with its shield."""

from __future__ import annotations

import random
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from algorithms.checkpoints import Array, State
from envs.driving_env import DrivingVectorEnv
from envs.world import Resumable


def generators() -> State:
    """Global generators of torch, numpy and Python; taking their state draws nothing."""
    kind, keys, *rest = np.random.get_state(legacy=True)  # noqa: NPY002
    version, words, gauss = random.getstate()
    arrays = {"torch": torch.get_rng_state().numpy(), "numpy": np.asarray(keys), "python": np.array(words, np.uint64)}
    return State(arrays, values={"numpy": [kind, *rest], "python": [version, gauss]})


def restore_generators(state: State) -> None:
    """Put the global generators back."""
    torch.set_rng_state(torch.from_numpy(state.arrays["torch"].copy()))
    kind, *rest = state.values["numpy"]
    np.random.set_state((kind, state.arrays["numpy"], *rest))  # noqa: NPY002
    version, gauss = state.values["python"]
    random.setstate((version, tuple(map(int, state.arrays["python"])), gauss))


def environment(env: DrivingVectorEnv) -> State:
    """Worlds, counters and finished episodes of an environment, and what its shield remembers."""
    arrays = env.snapshot()
    finished = arrays.pop("finished")
    values: dict[str, Any] = {}
    if isinstance(env.shield, Resumable):
        values["shield"] = env.shield.snapshot()
    return State(arrays, {"finished": finished}, values)


def restore_environment(env: DrivingVectorEnv, state: State) -> None:
    """Put an environment, made with the same arguments, where it was."""
    env.restore({**state.arrays, **state.growing})
    if isinstance(env.shield, Resumable):
        env.shield.restore(state.values["shield"])


def optimizers(named: Mapping[str, torch.optim.Optimizer]) -> State:
    """Moments and present learning rates of optimisers."""
    arrays: dict[str, Array] = {}
    for name, optimizer in named.items():
        for parameter, moments in optimizer.state_dict()["state"].items():
            for key, value in moments.items():
                arrays[f"{name}/{parameter}/{key}"] = torch.as_tensor(value).numpy()
    rates = {name: [float(group["lr"]) for group in optimizer.param_groups] for name, optimizer in named.items()}
    return State(arrays, values={"rates": rates})


def restore_optimizers(named: Mapping[str, torch.optim.Optimizer], state: State) -> None:
    """Put optimisers, over the same parameters, where they were."""
    for name, optimizer in named.items():
        moments: dict[int, dict[str, torch.Tensor]] = {}
        for path, values in state.part(name).arrays.items():
            parameter, _, key = path.partition("/")
            moments.setdefault(int(parameter), {})[key] = torch.from_numpy(values.copy())
        optimizer.load_state_dict({**optimizer.state_dict(), "state": moments})
        for group, rate in zip(optimizer.param_groups, state.values["rates"][name], strict=True):
            group["lr"] = rate

"""Toy CMDPs whose constrained optimum is known, as a vector environment and as OmniSafe's own kind."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

BOUND = 2.0
HORIZON = 5
BEST_UNCONSTRAINED = 1.0
BEST_CONSTRAINED = 0.2
COST_LIMIT = HORIZON * BEST_CONSTRAINED


def reward_of(action):
    """Concave, largest at 1 without the constraint."""
    return -((action - BEST_UNCONSTRAINED) ** 2)


class Push(VectorEnv):
    """Five pushes an episode: reward -(a - 1)^2 and noise of variance 4, cost a.

    The expected cost of an episode is 5 E[a], whatever the exploration. With limit 1, the best policy that keeps it
    always pushes 0.2; without, 1. The observation is (time, position), the position the sum of a tenth of all pushes.
    The noise matters: OmniSafe divides reward advantages by their deviation, and without noise their slope would be
    the same wherever the policy is, so that no multiplier could hold it in between.
    """

    def __init__(self, worlds: int, terminates: bool = False) -> None:
        self.noise = np.random.default_rng(5)
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.num_envs = worlds
        self.terminates = terminates
        self.single_observation_space = gymnasium.spaces.Box(-2.0, 2.0, (2,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-BOUND, BOUND, (1,), np.float32)
        self.time = np.zeros(worlds, np.int64)
        self.position = np.zeros(worlds)
        self.decisions = 0

    def observe(self):
        return np.stack([self.time / HORIZON, self.position], axis=1).astype(np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        self.time[:] = 0
        self.position[:] = 0.0
        return self.observe(), {}

    def step(self, actions):
        assert actions.shape == (self.num_envs, 1)
        self.decisions += 1
        push = np.clip(actions[:, 0].astype(np.float64), -BOUND, BOUND)
        self.time += 1
        self.position += 0.1 * push
        done = self.time >= HORIZON
        info = {"cost": push.copy(), "final_obs": self.observe(), "_final_obs": done}
        self.time[done] = 0
        self.position[done] = 0.0
        never = np.zeros(self.num_envs, bool)
        ends = (done, never) if self.terminates else (never, done)
        return self.observe(), reward_of(push) + 2.0 * self.noise.standard_normal(self.num_envs), *ends, info


def single_world_cmdp(core, terminates: bool):
    """`Push` written for OmniSafe's own path: one world, scalar tensors, its AutoReset and TimeLimit wrappers."""
    import torch

    class PushCMDP(core.CMDP):
        need_time_limit_wrapper = not terminates
        need_auto_reset_wrapper = True
        max_episode_steps = HORIZON
        _support_envs = ("Push-v0",)
        _num_envs = 1

        def __init__(self, env_id: str, **_unused: Any) -> None:
            self.vector = Push(1, terminates)
            self._observation_space = self.vector.single_observation_space
            self._action_space = self.vector.single_action_space

        def reset(self, seed=None, options=None):
            return torch.as_tensor(self.vector.reset()[0][0]), {}

        def step(self, action):
            _, reward, terminated, truncated, info = self.vector.step(action.numpy()[None])
            scalars = torch.as_tensor(reward[0]).float(), torch.as_tensor(info["cost"][0]).float()
            ends = torch.as_tensor(terminated[0]), torch.as_tensor(truncated[0])
            return torch.as_tensor(info["final_obs"][0]), *scalars, *ends, {}

        def set_seed(self, seed: int) -> None: ...

        def render(self) -> None: ...

        def close(self) -> None: ...

    return PushCMDP

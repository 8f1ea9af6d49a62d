"""Decisions a second of our CPO against OmniSafe's own, side by side: processors differ by more than two."""

import time

import gymnasium
import pytest
import torch

from algorithms.method import Budget, Task
from algorithms.omnisafe_library import close_logger, omnisafe_module, process_state_kept
from algorithms.registry import get_method
from envs.observation import OBSERVATION_SIZE
from envs.scenario import get_scenario
from tests.optional import needs_omnisafe

pytestmark = [
    pytest.mark.slow,
    needs_omnisafe,
]
WORLDS, EPISODE = 16, 120
ASKED, STOCK = 5000.0, 2600.0
"""Decisions a second that we aim at, and OmniSafe's own at 16 worlds, both on one core of another machine."""


def free_cmdp(core):
    """Worlds that cost no time: random observations that stay, no reward; episodes of 120 decisions."""

    class Free(core.CMDP):
        need_time_limit_wrapper = need_auto_reset_wrapper = False
        _support_envs = ("Free-v0",)

        def __init__(self, env_id, num_envs=1, **_unused):
            self._num_envs = num_envs  # OmniSafe makes a second environment, of one world, that it never steps
            self._observation_space = gymnasium.spaces.Box(-1.0, 1.0, (OBSERVATION_SIZE,))
            self._action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,))
            self.observations, self.zeros = torch.rand(num_envs, OBSERVATION_SIZE), torch.zeros(num_envs)
            self.never, self.time = torch.zeros(num_envs, dtype=torch.bool), 0

        def reset(self, seed=None, options=None):
            return self.observations, {}

        def step(self, action):
            self.time += 1
            ends = self.never if self.time % EPISODE else ~self.never
            info = {"final_observation": self.observations, "_final_observation": ends} if ends.any() else {}
            return self.observations, self.zeros, self.zeros, self.never, ends, info

        def set_seed(self, seed): ...

        def render(self): ...

        def close(self): ...

    return Free


def stock_pace(decisions, folder):
    """OmniSafe's CPO with its defaults (64 x 64 tanh, 10 passes, batches of 128), on one thread, training only."""
    with process_state_kept():
        core = omnisafe_module("omnisafe.envs.core")
        cmdp = free_cmdp(core)
        core.env_register(cmdp)
        try:
            custom = {
                "train_cfgs": {
                    "device": "cpu", "torch_threads": 1, "vector_env_nums": WORLDS, "total_steps": decisions,
                },
                "logger_cfgs": {"use_wandb": False, "use_tensorboard": False, "log_dir": str(folder)},
            }  # fmt: skip
            trainer = omnisafe_module().Agent("CPO", "Free-v0", custom_cfgs=custom).agent
            start = time.process_time()
            trainer.learn()
            seconds = time.process_time() - start
            close_logger(trainer.logger)
        finally:
            core.env_unregister(cmdp)
    return decisions / seconds


def our_pace(decisions):
    """`cpo` with its settings (256-wide networks), on scenario a, traffic included."""
    scenario = get_scenario("a")
    task = Task(scenario, 0, Budget(decisions * scenario.substeps))
    start = time.process_time()
    get_method("cpo").train(task)
    return decisions / (time.process_time() - start)


def test_cpo_is_as_much_faster_than_omnisafes_own_as_was_asked(tmp_path):
    our_pace(2_000)  # imports and compiled kernels
    stock, ours = stock_pace(20_000, tmp_path), our_pace(40_000)
    print(f"\nOmniSafe's own {stock:.0f}/s, ours {ours:.0f}/s, {ours / stock:.2f} times")
    assert ours / stock >= ASKED / STOCK

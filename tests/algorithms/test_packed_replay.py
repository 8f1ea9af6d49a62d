"""The packed replay buffer holds and samples what stable-baselines3's does."""

import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer

from algorithms.fast_sac import reproducible
from algorithms.packed_replay import PackedReplayBuffer


def test_truncation_is_stored_as_a_continuation():
    space = spaces.Box(-1.0, 1.0, (3,), np.float32)
    packed = PackedReplayBuffer(10, space, spaces.Box(-1.0, 1.0, (1,), np.float32), "cpu", 2)
    zeros, ones = np.zeros((2, 3), np.float32), np.ones((2, 3), np.float32)
    infos = [{"TimeLimit.truncated": True}, {"TimeLimit.truncated": False}]
    packed.add(zeros, ones, np.zeros((2, 1)), np.array([1.0, 2.0]), np.array([True, True]), infos)
    assert packed.rows[0, :, 5].tolist() == [0.0, 1.0]
    assert packed.rows[0, :, 4].tolist() == [1.0, 2.0]


def test_packed_buffer_samples_what_the_original_samples():
    observation, action = spaces.Box(-1.0, 1.0, (3,), np.float32), spaces.Box(-1.0, 1.0, (2,), np.float32)
    buffers = [kind(40, observation, action, "cpu", 4) for kind in (PackedReplayBuffer, ReplayBuffer)]
    rng = np.random.default_rng(0)
    for _ in range(13):  # more than the capacity of 10: the ring closes
        transition = (
            rng.random((4, 3), np.float32), rng.random((4, 3), np.float32), rng.random((4, 2), np.float32),
            rng.random(4, np.float32), rng.random(4) < 0.3,
        )  # fmt: skip
        for buffer in buffers:
            buffer.add(*transition, [{} for _ in range(4)])
    batches = []
    for buffer in buffers:
        with reproducible(5):
            batches.append(buffer.sample(32))
    ours, theirs = batches
    for name in ("observations", "actions", "next_observations", "dones", "rewards"):
        assert torch.equal(getattr(ours, name), getattr(theirs, name)), name
    with pytest.raises(ValueError, match="does not normalise"):
        buffers[0].sample(32, env=object())

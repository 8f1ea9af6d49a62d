"""What one update of SAC works out for its batch, in memory that the next update uses again."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from algorithms import sac_kernels
from algorithms.perceptron import shared
from algorithms.sac_kernels import Single


class Minibatch:
    """All that one update works out for a batch but hidden layers and gradients of weights.

    A state has n numbers, an action a.

    Attributes:
        size: Transitions.
        actions: a.
        states: States, then next states, shape (2 size, n).
        state_action: What was done, shape (size, n + a).
        policy_action: The same states with actions of the actor.
        next_action: Next states with actions of the actor.
        reward: Shape (size,).
        goes_on: 1 - terminated, shape (size,).
        noise: Standard normal, for states and next states, shape (2 size, a), only an array. Of this shape are also
            mean, raw_log_std, log_std (clamped), std, action (at first before tanh), slope (of tanh) and log_slope.
        log_prob: Of the actor's actions, shape (2 size,).
        target: Of the critics, shape (size,).
        values: Of both critics, two of shape (size, 1).
        slopes: Gradients by the values.
        through: Gradients by the actor's actions through both critics, two of shape (size, a).
        to_mean: Gradient by the actor's mean, shape (size, a).
        to_log_std: Gradient by its raw log standard deviation, likewise.
    """

    def __init__(self, size: int, n: int, a: int) -> None:
        self.size, self.actions = size, a
        self.states = shared(2 * size, n)
        self.state_action, self.policy_action, self.next_action = (shared(size, n + a) for _ in range(3))
        self.noise = np.zeros((2 * size, a), np.float32)
        self.reward, self.goes_on, self.target = (shared(size) for _ in range(3))
        self.mean, self.raw_log_std, self.log_std, self.std = (shared(2 * size, a) for _ in range(4))
        self.action, self.slope, self.log_slope = (shared(2 * size, a) for _ in range(3))
        self.log_prob = shared(2 * size)
        self.values, self.slopes = ((shared(size, 1), shared(size, 1)) for _ in range(2))
        self.through = (shared(size, a), shared(size, a))
        self.to_mean, self.to_log_std = shared(size, a), shared(size, a)

    def take(self, transitions: Single, chosen: npt.NDArray[np.int64], noise: Single) -> None:
        """Fill in states, actions, rewards and ends of the chosen rows."""
        self.noise = noise
        sac_kernels.gather(
            transitions, chosen, self.states.array, self.state_action.array, self.policy_action.array,
            self.next_action.array, self.reward.array, self.goes_on.array,
        )  # fmt: skip

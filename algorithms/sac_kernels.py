"""The element-wise parts of SAC's update, compiled: torch takes ten times as long for the call as for the arithmetic.

Each kernel does the operations of the formula that it names one by one, in single precision and in that order, as torch
would; what is transcendental, and sums over a batch but those of bias gradients, are left to torch.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from envs.compiled import njit

Single = npt.NDArray[np.float32]

LOG_STD_MIN: Final = np.float32(-20.0)
LOG_STD_MAX: Final = np.float32(2.0)
SQUASH_EPSILON: Final = np.float32(1e-6)
"""stable-baselines3's constants of the squashed Gaussian."""
HALF_LOG_TWO_PI: Final = np.float32(0.5 * math.log(2.0 * math.pi))


@njit
def gather(
    transitions: Single,
    chosen: npt.NDArray[np.int64],
    states: Single,
    state_action: Single,
    policy_action: Single,
    next_action: Single,
    reward: Single,
    goes_on: Single,
) -> None:
    """Distribute drawn transitions: every state, in the first columns of whatever a network takes.

    Args:
        transitions: Rows of a `PackedReplayBuffer`.
        chosen: Row of each member of the batch.
        states: Of the batch, then its next states, shape (2 batch, n).
        state_action: What was done, shape (batch, n + a).
        policy_action: The same states, with room for actions.
        next_action: The next states, with room for actions.
        reward: Shape (batch,).
        goes_on: 1 - terminated, shape (batch,).
    """
    batch, n = len(chosen), states.shape[1]
    a = state_action.shape[1] - n
    for i in range(batch):
        row = transitions[chosen[i]]
        for j in range(n):
            states[i, j] = state_action[i, j] = policy_action[i, j] = row[j]
            states[batch + i, j] = next_action[i, j] = row[n + a + 2 + j]
        for j in range(n, n + a):
            state_action[i, j] = row[j]
        reward[i] = row[n + a]
        goes_on[i] = np.float32(1.0) - row[n + a + 1]


@njit
def add_noise(mean: Single, std: Single, noise: Single, raw_action: Single) -> None:
    """Mean + std noise, all of shape (2 batch, a)."""
    for i in range(mean.shape[0]):
        for j in range(mean.shape[1]):
            raw_action[i, j] = mean[i, j] + std[i, j] * noise[i, j]


@njit
def slope_of_tanh(action: Single, slope: Single, shifted: Single) -> None:
    """1 - action^2, and that plus `SQUASH_EPSILON`, all of shape (2 batch, a)."""
    for i in range(action.shape[0]):
        for j in range(action.shape[1]):
            slope[i, j] = np.float32(1.0) - action[i, j] * action[i, j]
            shifted[i, j] = slope[i, j] + SQUASH_EPSILON


@njit
def log_probability(
    noise: Single,
    log_std: Single,
    log_slope: Single,
    action: Single,
    log_prob: Single,
    policy_action: Single,
    next_action: Single,
) -> None:
    """Sum over a of -noise^2 / 2 - log_std - log(2 pi) / 2 - log_slope, shape (2 batch,); actions go beside states."""
    batch, a = len(policy_action), action.shape[1]
    n = policy_action.shape[1] - a
    for i in range(len(log_prob)):
        total = np.float32(0.0)
        for j in range(a):
            total += np.float32(-0.5) * noise[i, j] * noise[i, j] - log_std[i, j] - HALF_LOG_TWO_PI - log_slope[i, j]
        log_prob[i] = total
    for i in range(batch):
        for j in range(a):
            policy_action[i, n + j] = action[i, j]
            next_action[i, n + j] = action[batch + i, j]


@njit
def bellman_target(
    reward: Single,
    goes_on: Single,
    gamma: np.float32,
    first: Single,
    second: Single,
    alpha: np.float32,
    log_prob: Single,
    target: Single,
) -> None:
    """Reward + goes_on gamma (min(first, second) - alpha log_prob); values (batch, 1), log_prob (2 batch,)."""
    batch = len(reward)
    for i in range(batch):
        one, other = first[i, 0], second[i, 0]
        least = one if one <= other or one != one else other  # what is not a number is not hidden
        target[i] = reward[i] + goes_on[i] * gamma * (least - alpha * log_prob[batch + i])


@njit
def squared_error(value: Single, target: Single, square: Single, gradient: Single) -> None:
    """(value - target)^2, shape (batch,), and the gradient of half its mean, shape (batch, 1)."""
    batch = len(target)
    for i in range(batch):
        error = value[i, 0] - target[i]
        square[i] = error * error
        gradient[i, 0] = error / np.float32(batch)


@njit
def least_value(
    first: Single,
    second: Single,
    alpha: np.float32,
    log_prob: Single,
    to_first: Single,
    to_second: Single,
    loss: Single,
) -> None:
    """Alpha log_prob - min(first, second), shape (batch,), and the gradients of its mean by both, shape (batch, 1)."""
    batch = len(loss)
    share = np.float32(-1.0 / batch)
    for i in range(batch):
        of_first = first[i, 0] <= second[i, 0] or first[i, 0] != first[i, 0]  # what is not a number is not hidden
        to_first[i, 0] = share if of_first else np.float32(0.0)
        to_second[i, 0] = np.float32(0.0) if of_first else share
        loss[i] = alpha * log_prob[i] - (first[i, 0] if of_first else second[i, 0])


@njit
def through_action(
    through_first: Single,
    through_second: Single,
    alpha_share: np.float32,
    action: Single,
    slope: Single,
    std: Single,
    noise: Single,
    raw_log_std: Single,
    to_mean: Single,
    to_log_std: Single,
) -> None:
    """Gradients of the actor's loss by its two heads, shape (batch, a), from those by the action through the critics.

    d log pi / d action = 2 action / (1 - action^2 + epsilon); action = tanh(mean + std noise). alpha_share is
    alpha / batch; a clamped log standard deviation has no gradient (times 0: what is not a number stays so).
    """
    for i in range(to_mean.shape[0]):
        for j in range(to_mean.shape[1]):
            gradient = through_first[i, j] + through_second[i, j]
            gradient += np.float32(2.0) * alpha_share * action[i, j] / (slope[i, j] + SQUASH_EPSILON)
            to_mean[i, j] = gradient * slope[i, j]
            inside = LOG_STD_MIN <= raw_log_std[i, j] <= LOG_STD_MAX
            by_log_std = to_mean[i, j] * std[i, j] * noise[i, j] - alpha_share
            to_log_std[i, j] = by_log_std if inside else by_log_std * np.float32(0.0)


@njit
def bias_and_relu(product: Single, bias: Single) -> None:
    """Add the bias, shape (width,), to each row of (batch, width), and raise what is below 0 to 0, in place."""
    for i in range(product.shape[0]):
        for j in range(product.shape[1]):
            value = product[i, j] + bias[j]
            product[i, j] = np.float32(0.0) if value <= np.float32(0.0) else value


@njit
def through_relu(gradient: Single, output: Single) -> None:
    """The gradient, in place, where the output of the ReLU is positive; else 0. Both of shape (batch, width)."""
    for i in range(gradient.shape[0]):
        for j in range(gradient.shape[1]):
            gradient[i, j] = np.float32(0.0) if output[i, j] <= np.float32(0.0) else gradient[i, j]


@njit
def through_relu_and_bias(gradient: Single, output: Single, by_bias: Single, block: Single) -> None:
    """`through_relu`, and the sum of the result over the batch, shape (width,); block is room for as much.

    Sums of 16 rows are added up: the order of torch's own sum for layers of 256 and up to 256 rows.
    """
    batch, width = gradient.shape
    by_bias[:] = np.float32(0.0)
    start = 0
    while start < batch:
        stop = min(start + 16, batch)
        block[:] = np.float32(0.0)
        for i in range(start, stop):
            for j in range(width):
                gradient[i, j] = np.float32(0.0) if output[i, j] <= np.float32(0.0) else gradient[i, j]
                block[j] += gradient[i, j]
        for j in range(width):
            by_bias[j] += block[j]
        start = stop

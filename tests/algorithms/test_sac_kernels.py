"""Each compiled part of SAC's update against its formula in torch, in the same precision."""

import numpy as np
import pytest
import torch

from algorithms import sac_kernels
from algorithms.minibatch import Minibatch

pytestmark = pytest.mark.kernels
BATCH, N, A = 37, 5, 2


def drawn(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def test_a_batch_has_every_state_where_each_network_takes_it():
    transitions = drawn(90, 2 * N + A + 2)
    transitions[:, N + A + 1] = transitions[:, N + A + 1] > 0.0
    chosen = np.random.default_rng(1).integers(0, 90, BATCH)
    batch = Minibatch(BATCH, N, A)
    batch.take(transitions, chosen, drawn(2 * BATCH, A))
    rows = transitions[chosen]
    states, next_states = rows[:, :N], rows[:, -N:]
    assert np.array_equal(batch.states.tensor.numpy(), np.concatenate([states, next_states]))
    assert np.array_equal(batch.state_action.array, rows[:, : N + A])
    assert np.array_equal(batch.policy_action.array[:, :N], states)
    assert np.array_equal(batch.next_action.array[:, :N], next_states)
    assert np.array_equal(batch.reward.array, rows[:, N + A])
    assert np.array_equal(batch.goes_on.array, 1.0 - rows[:, N + A + 1])
    assert 0.0 < batch.goes_on.array.mean() < 1.0


def test_squashed_gaussian_is_that_of_torchs_distributions():
    mean, log_std, noise = drawn(2 * BATCH, A), 0.3 * drawn(2 * BATCH, A, seed=1), drawn(2 * BATCH, A, seed=2)
    batch = Minibatch(BATCH, N, A)
    raw, log_prob = batch.action.array, batch.log_prob.array
    sac_kernels.add_noise(mean, np.exp(log_std), noise, raw)
    gaussian = torch.distributions.Normal(torch.from_numpy(mean), torch.from_numpy(log_std).exp())
    expected = gaussian.log_prob(torch.from_numpy(raw.copy())).sum(1)
    np.tanh(raw, out=raw)
    sac_kernels.slope_of_tanh(raw, batch.slope.array, batch.log_slope.array)
    np.log(batch.log_slope.array, out=batch.log_slope.array)
    expected -= torch.log(1.0 - torch.from_numpy(raw) ** 2 + 1e-6).sum(1)
    sac_kernels.log_probability(
        noise, log_std, batch.log_slope.array, raw, log_prob,
        batch.policy_action.array, batch.next_action.array,
    )  # fmt: skip
    assert log_prob == pytest.approx(expected.numpy(), rel=1e-4, abs=1e-4)
    assert np.array_equal(batch.policy_action.array[:, N:], raw[:BATCH])
    assert np.array_equal(batch.next_action.array[:, N:], raw[BATCH:])


def test_target_is_bellmans_and_hides_nothing_that_is_not_a_number():
    reward, first, second = drawn(BATCH), drawn(BATCH, 1, seed=1), drawn(BATCH, 1, seed=2)
    goes_on, log_prob = (drawn(BATCH, seed=3) > 0.0).astype(np.float32), drawn(2 * BATCH, seed=4)
    target = np.empty(BATCH, np.float32)
    first[3], second[5] = np.nan, np.nan
    sac_kernels.bellman_target(reward, goes_on, np.float32(0.9), first, second, np.float32(0.2), log_prob, target)
    least = np.minimum(first, second)[:, 0]
    assert target == pytest.approx(reward + 0.9 * goes_on * (least - 0.2 * log_prob[BATCH:]), rel=1e-5, nan_ok=True)
    assert np.flatnonzero(np.isnan(target)).tolist() == [3, 5]


def test_gradients_of_both_losses_by_the_values_are_autograds():
    first, second = (torch.from_numpy(drawn(BATCH, 1, seed=seed)).requires_grad_() for seed in (1, 2))
    target, log_prob = torch.from_numpy(drawn(BATCH, seed=3)), torch.from_numpy(drawn(2 * BATCH, seed=4))
    terms, gradients = np.empty((2, BATCH), np.float32), np.empty((3, BATCH, 1), np.float32)
    values = [value.detach().numpy() for value in (first, second)]
    sac_kernels.squared_error(values[0], target.numpy(), terms[0], gradients[0])
    sac_kernels.least_value(*values, np.float32(0.2), log_prob.numpy(), gradients[1], gradients[2], terms[1])

    square = (first[:, 0] - target).square()
    (by_first,) = torch.autograd.grad(0.5 * square.mean(), first)
    loss = 0.2 * log_prob[:BATCH] - torch.minimum(first, second)[:, 0]
    by_both = torch.autograd.grad(loss.mean(), (first, second))
    for ours, theirs in zip([*terms, *gradients], [square, loss, by_first, *by_both], strict=True):
        assert ours == pytest.approx(theirs.detach().numpy(), rel=1e-5)
    assert 0.0 < float((by_both[0] != 0.0).float().mean()) < 1.0


def test_neither_critic_hides_what_is_not_a_number_in_the_other():
    number, nothing = np.ones((1, 1), np.float32), np.full((1, 1), np.nan, np.float32)
    for values in ((number, nothing), (nothing, number)):
        loss, gradients = np.zeros(1, np.float32), np.zeros((2, 1, 1), np.float32)
        sac_kernels.least_value(*values, np.float32(0.1), np.zeros(2, np.float32), *gradients, loss)
        assert np.isnan(loss[0])


def test_gradients_by_both_heads_of_the_actor_are_autograds():
    mean, raw = (torch.from_numpy(drawn(BATCH, A, seed=seed)) for seed in (1, 2))
    raw[::5], raw[1::5] = raw[::5] - 25.0, raw[1::5] + 5.0  # below and above the limits
    mean.requires_grad_()
    raw_log_std = raw.requires_grad_()
    noise, through_first, through_second = (torch.from_numpy(drawn(BATCH, A, seed=seed)) for seed in (3, 4, 5))
    alpha = 0.3
    log_std = raw_log_std.clamp(-20.0, 2.0)
    action = torch.tanh(mean + log_std.exp() * noise)
    slope = 1.0 - action**2
    log_prob = (-0.5 * noise**2 - log_std - torch.log(slope + 1e-6)).sum(1)
    expected = torch.autograd.grad(
        alpha * log_prob.mean() + (action * (through_first + through_second)).sum(), (mean, raw_log_std)
    )
    found = np.empty((2, BATCH, A), np.float32)
    with torch.no_grad():
        sac_kernels.through_action(
            through_first.numpy(), through_second.numpy(), np.float32(alpha / BATCH), action.numpy(), slope.numpy(),
            log_std.exp().numpy(), noise.numpy(), raw_log_std.numpy(), *found,
        )  # fmt: skip
    for ours, theirs in zip(found, expected, strict=True):
        assert ours == pytest.approx(theirs.numpy(), rel=1e-4, abs=1e-6)
    beyond = (log_std != raw_log_std).numpy()
    assert 0.3 < beyond.mean() < 0.7
    assert not found[1][beyond].any()


@pytest.mark.parametrize("batch", [1, 16, 37, 64])
def test_gradient_passes_a_relu_where_it_is_open_and_its_sum_is_that_of_the_bias(batch):
    gradient, output = drawn(batch, 9), np.maximum(drawn(batch, 9, seed=1), np.float32(0.0))
    expected = np.where(output > 0.0, gradient, np.float32(0.0))
    alone, by_bias = gradient.copy(), np.full(9, np.nan, np.float32)
    sac_kernels.through_relu(alone, output)
    sac_kernels.through_relu_and_bias(gradient, output, by_bias, np.empty(9, np.float32))
    assert np.array_equal(alone, expected)
    assert np.array_equal(gradient, expected)
    assert by_bias == pytest.approx(expected.sum(0, dtype=np.float64), abs=1e-5)


def test_bias_and_relu_are_those_of_a_linear_layer_and_pass_on_what_is_not_a_number():
    product, bias = drawn(BATCH, 9), drawn(9, seed=1)
    product[4, 5] = np.nan
    expected = torch.relu(torch.from_numpy(product) + torch.from_numpy(bias)).numpy()
    sac_kernels.bias_and_relu(product, bias)
    assert np.array_equal(product, expected, equal_nan=True)
    assert np.isnan(product).sum() == 1
    assert 0.0 < (product == 0.0).mean() < 1.0

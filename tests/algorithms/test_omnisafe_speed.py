"""The faster loops give OmniSafe's numbers, bit for bit."""

from types import SimpleNamespace

import gymnasium
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.utils.data import DataLoader, TensorDataset

from algorithms.omnisafe_library import omnisafe_module, process_state_kept
from algorithms.omnisafe_speed import (
    ShuffledBatches,
    discounted_sums,
    fast_loops,
    fisher_product,
    joined_storage,
    lean_step,
    remembering,
)
from tests.optional import needs_omnisafe


@pytest.mark.parametrize("size", [1, 7, 64, 100])
def test_batches_are_those_of_torch_pass_after_pass(size):
    dataset = TensorDataset(torch.arange(64.0), torch.randn(64, 3))
    drawn = []
    for loader in (DataLoader(dataset, batch_size=size, shuffle=True), ShuffledBatches(dataset, size, shuffle=True)):
        torch.manual_seed(1)
        drawn.append([batch for _ in range(3) for batch in loader])
    assert len(drawn[0]) == len(drawn[1])
    for theirs, ours in zip(*drawn, strict=True):
        assert all(torch.equal(a, b) for a, b in zip(theirs, ours, strict=True))


def test_batches_in_order_are_refused():
    with pytest.raises(ValueError, match="shuffle = False"):
        ShuffledBatches(TensorDataset(torch.zeros(3)), 2, shuffle=False)


def test_discounted_sums_worked_by_hand():
    assert discounted_sums(torch.tensor([1.0, 2.0, 4.0]), 0.5).tolist() == [3.0, 4.0, 4.0]


@needs_omnisafe
@given(st.lists(st.floats(-1e3, 1e3, width=32), min_size=1, max_size=50), st.floats(0.0, 1.0))
def test_discounted_sums_are_omnisafes(values, discount):
    theirs = omnisafe_module("omnisafe.utils.math").discount_cumsum(torch.tensor(values), discount)
    assert torch.equal(discounted_sums(torch.tensor(values), discount), theirs)


@needs_omnisafe
def test_joined_storage_holds_and_gives_what_omnisafes_buffer_does():
    box = gymnasium.spaces.Box(-1.0, 1.0, (3,))
    original = omnisafe_module("omnisafe.common.buffer").VectorOnPolicyBuffer
    arguments = {
        "obs_space": box, "act_space": box, "size": 6, "gamma": 0.9, "lam": 0.8, "lam_c": 0.7,
        "advantage_estimator": "gae", "penalty_coefficient": 0.0, "standardized_adv_r": True,
        "standardized_adv_c": True, "num_envs": 4,
    }  # fmt: skip
    buffers = [original(**arguments), joined_storage(original)(**arguments)]
    for _ in range(2):  # a buffer is used again in the next epoch
        for _ in range(6):
            scalars = {key: torch.randn(4) for key in ("reward", "cost", "value_r", "value_c", "logp")}
            vectors = {key: torch.randn(4, 3) for key in ("obs", "act")}
            for buffer in buffers:
                buffer.store(**scalars, **vectors)
        for world in range(4):
            for buffer in buffers:
                buffer.finish_path(torch.ones(1), torch.zeros(1), world)
        theirs, ours = (buffer.get() for buffer in buffers)
        assert theirs.keys() == ours.keys()
        assert all(torch.equal(theirs[key], ours[key]) for key in theirs)


def actor_critic(activation):
    network = SimpleNamespace(hidden_sizes=[8, 8], activation=activation, lr=1e-3)
    settings = SimpleNamespace(
        weight_initialization_mode="kaiming_uniform", actor_type="gaussian_learning", linear_lr_decay=True,
        actor=network, critic=network,
    )  # fmt: skip
    box = gymnasium.spaces.Box(-1.0, 1.0, (3,))
    return omnisafe_module("omnisafe.models.actor_critic").ConstraintActorCritic(box, box, settings, 1)


@needs_omnisafe
@pytest.mark.parametrize("activation", ["relu", "tanh"])
@pytest.mark.parametrize("deterministic", [False, True])
@pytest.mark.parametrize("shape", [(5, 3), (3,)], ids=["worlds", "one"])
def test_a_lean_step_is_omnisafes(activation, deterministic, shape):
    agent = actor_critic(activation)
    observations = torch.randn(shape)
    kept = observations.clone()
    torch.manual_seed(1)
    theirs = agent.step(observations, deterministic)
    torch.manual_seed(1)
    ours = lean_step(agent, observations, deterministic)
    assert all(torch.equal(a, b) for a, b in zip(ours, theirs, strict=True))
    assert torch.equal(observations, kept)


@needs_omnisafe
@pytest.mark.parametrize("activation", ["relu", "tanh"])
def test_a_fisher_product_is_omnisafes_also_when_policy_or_observations_are_others(activation):
    theirs = omnisafe_module("omnisafe.algorithms.on_policy.base.natural_pg").NaturalPG._fvp
    stored = []
    trainer = SimpleNamespace(
        _actor_critic=actor_critic(activation), _fvp_obs=torch.randn(7, 3),
        _logger=SimpleNamespace(store=stored.append), _cfgs=SimpleNamespace(algo_cfgs=SimpleNamespace(cg_damping=0.1)),
    )  # fmt: skip
    parameters = list(trainer._actor_critic.actor.parameters())
    seen = []
    for change in ("none", "vector", "policy", "observations"):
        vector = torch.randn(sum(parameter.numel() for parameter in parameters))
        if change == "policy":
            parameters[0].data.add_(0.1)
        if change == "observations":
            trainer._fvp_obs = torch.randn(7, 3)
        ours = fisher_product(trainer, vector)
        assert torch.equal(ours, theirs(trainer, vector))
        seen.append(ours - 0.1 * vector)
    assert stored[::2] == stored[1::2]
    assert all(product.abs().max() > 1e-3 for product in seen)


@needs_omnisafe
def test_a_policy_is_asked_once_for_the_same_and_again_when_policy_or_observations_are_others():
    actor = actor_critic("relu").actor
    asked = []

    def distribution(actor, observations):
        asked.append(observations)
        return type(actor)._distribution(actor, observations)

    remembered, observations = remembering(distribution), torch.randn(7, 3)
    with torch.no_grad():
        first = remembered(actor, observations)
        assert remembered(actor, observations) is first
        next(actor.mean.parameters()).data.add_(0.1)
        other_policy = remembered(actor, observations)
        assert torch.equal(other_policy.mean, actor(observations).mean)
        others = torch.randn(7, 3)
        assert torch.equal(remembered(actor, others).mean, actor(others).mean)
    assert len(asked) == 3
    assert not torch.equal(first.mean, other_policy.mean)


@needs_omnisafe
def test_a_policy_with_gradients_has_a_graph_of_its_own_each_time():
    actor, observations = actor_critic("relu").actor, torch.randn(7, 3)
    remembered = remembering(type(actor)._distribution)
    with torch.no_grad():
        remembered(actor, observations)
    for _ in range(2):
        actor.zero_grad()
        remembered(actor, observations).mean.sum().backward()
        assert all(parameter.grad.abs().max() > 0 for parameter in actor.mean.parameters())


@needs_omnisafe
def test_the_originals_are_back_afterwards():
    modules = [omnisafe_module(f"omnisafe.algorithms.on_policy.{name}") for name in (
        "base.policy_gradient", "base.natural_pg", "first_order.focops", "first_order.cup",
    )]  # fmt: skip
    buffer = omnisafe_module("omnisafe.common.buffer.onpolicy_buffer")
    before = [module.DataLoader for module in modules], buffer.discount_cumsum

    def inside():
        assert all(module.DataLoader is ShuffledBatches for module in modules)
        assert buffer.discount_cumsum is discounted_sums
        raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"), process_state_kept(), fast_loops():
        inside()
    assert ([module.DataLoader for module in modules], buffer.discount_cumsum) == before

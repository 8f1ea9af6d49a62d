"""The hand-written update gives what stable-baselines3's update gives."""

import copy
import random

import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3 import SAC
from stable_baselines3.common.utils import set_random_seed

from algorithms.fast_sac import FastSAC, HalfFastSAC, denormals_are_zero, reproducible
from algorithms.perceptron import processor_rounds
from algorithms.sb3_env import StableBaselinesEnv
from envs.driving_env import DrivingVectorEnv

WORLDS = 8


def trained(learner, updates, batch=64, seed=1, width=32):
    env = DrivingVectorEnv("b", WORLDS)
    env.reset(seed=3)
    with reproducible(seed):
        model = learner(
            "MlpPolicy",
            StableBaselinesEnv(env),
            buffer_size=2000,
            learning_starts=400,
            batch_size=batch,
            train_freq=1,
            gradient_steps=2,
            gamma=0.951,
            learning_rate=6e-4,
            policy_kwargs={"net_arch": {"pi": [width] * 4, "qf": [width] * 3}},
            seed=seed,
            device="cpu",
        )
        model.learn(400 + WORLDS * updates // 2)
    return model


@pytest.fixture(scope="module")
def both():
    return trained(SAC, 60), trained(FastSAC, 60)


def test_weights_equal_the_stock_learners_after_many_updates(both):
    stock, fast = (dict(model.policy.named_parameters()) for model in both)
    assert stock.keys() == fast.keys()
    for name, value in stock.items():
        error = float(((value - fast[name]).norm() / value.norm()).detach())
        assert error < 1e-5, f"{name}: {error}"


def test_temperature_equals_the_stock_learners(both):
    stock, fast = both
    assert fast.log_ent_coef.item() == pytest.approx(stock.log_ent_coef.item(), rel=1e-5)
    assert fast.log_ent_coef.item() != 0.0


def one_update_after(change):
    """Stock's learner and ours, equal but for rounding, changed alike, then one update of the same batch."""
    models = trained(SAC, 4), trained(FastSAC, 4)
    for model in models:
        for optimizer in (model.actor.optimizer, model.critic.optimizer, model.ent_coef_optimizer):
            for state in optimizer.state.values():
                state["exp_avg"].zero_()
        with torch.no_grad():
            change(model)
        with reproducible(9):
            model.train(1, 64)
    return models


def gradients(optimizer):
    """Of the last update, from Adam's first moment: unlike its step, that is not the same for a gradient of twice."""
    factor = 1.0 - optimizer.param_groups[0]["betas"][0]
    return torch.cat([state["exp_avg"].reshape(-1) for state in optimizer.state.values()]) / factor


def weights(model):
    return torch.cat([parameter.detach().reshape(-1) for parameter in model.policy.parameters()])


def test_batches_of_any_size_in_turn_are_learned_from_as_by_the_stock_learner():
    # 130 is the width of layers that go through the same two buffers; halves of 17 draw other noise than 34 at once.
    models = trained(SAC, 4, width=130), trained(FastSAC, 4, width=130)
    for batch in (17, 300, 1, 64, 17):
        for model in models:
            with reproducible(batch):
                model.train(2, batch)
        assert float((weights(models[0]) - weights(models[1])).norm()) < 1e-5 * float(weights(models[0]).norm())


def test_it_reports_means_over_the_updates_and_follows_a_schedule_as_the_stock_learner_does():
    reported = []
    for model in (trained(SAC, 4), trained(FastSAC, 4)):
        model.lr_schedule = lambda _: 5e-3
        with reproducible(9):
            model.train(3, 64)
        reported.append(dict(model.logger.name_to_value))
        assert model.actor.optimizer.param_groups[0]["lr"] == 5e-3
    stock, fast = reported
    assert fast.keys() == stock.keys()
    for key in ("actor_loss", "critic_loss", "ent_coef", "ent_coef_loss", "n_updates"):
        assert fast[f"train/{key}"] == pytest.approx(stock[f"train/{key}"], rel=1e-5)
        assert stock[f"train/{key}"] != 0.0


@pytest.mark.parametrize("part", ["actor", "critic", "temperature"])
def test_gradients_of_one_update_equal_autograds(part):
    stock, fast = one_update_after(lambda model: None)
    theirs, ours = (
        gradients(model.ent_coef_optimizer if part == "temperature" else getattr(model, part).optimizer)
        for model in (stock, fast)
    )
    assert float(theirs.norm()) > 1e-4
    assert float((ours - theirs).norm()) <= 1e-5 * float(theirs.norm())


def test_a_log_standard_deviation_beyond_its_limits_is_clamped_and_has_no_gradient():
    def push(model):
        model.actor.log_std.bias.copy_(torch.tensor([9.0, -30.0]))

    stock, fast = one_update_after(push)
    for name, value in stock.actor.named_parameters():
        ours = dict(fast.actor.named_parameters())[name]
        # Stock's log-probability of so narrow a Gaussian loses digits that ours keeps.
        assert float(((value - ours).norm() / value.norm()).detach()) < 1e-3, name
    assert torch.equal(fast.actor.log_std.bias.grad, torch.zeros(2))
    assert torch.equal(stock.actor.log_std.bias.grad, torch.zeros(2))


def test_it_is_saved_without_its_buffers_and_goes_on_where_it_was(tmp_path):
    model = trained(FastSAC, 4)
    model.save(tmp_path / "fast.zip")
    trained(SAC, 4).save(tmp_path / "stock.zip")
    assert (tmp_path / "fast.zip").stat().st_size < 1.1 * (tmp_path / "stock.zip").stat().st_size
    again = FastSAC.load(tmp_path / "fast.zip", env=model.get_env(), device="cpu")
    again.replay_buffer, again._logger = model.replay_buffer, model.logger
    for learner in (model, again):
        with reproducible(2):
            learner.train(5, 64)
    for one, other in zip(model.policy.parameters(), again.policy.parameters(), strict=True):
        assert torch.equal(one, other)


def test_parameters_put_in_by_vector_are_those_that_it_trains():
    model, twin = trained(FastSAC, 4), trained(FastSAC, 4)
    vector = model.policy.parameters_to_vector()
    model.policy.load_from_vector(vector)
    for learner in (model, twin):
        with reproducible(2):
            learner.train(5, 64)
    assert np.abs(model.policy.parameters_to_vector() - vector).max() > 1e-4
    assert np.array_equal(model.policy.parameters_to_vector(), twin.policy.parameters_to_vector())


def test_gradients_set_to_none_come_back_and_a_copy_says_that_it_cannot_train():
    model, twin = trained(FastSAC, 4), trained(FastSAC, 4)
    model.actor.optimizer.zero_grad()
    for learner in (model, twin):
        with reproducible(2):
            learner.train(2, 64)
    assert torch.equal(weights(model), weights(twin))
    with pytest.raises(ValueError, match="a copy of FastSAC cannot train: save the learner and load it"):
        copy.deepcopy(model).train(1, 64)


def test_who_counted_denormal_numbers_as_zero_before_goes_on_doing_so():
    def flushed():
        return float(torch.full((1,), 1e-40) * 1.0) == 0.0

    for before in (False, True):
        torch.set_flush_denormal(before)
        try:
            with denormals_are_zero():
                assert flushed()
            assert flushed() is before
        finally:
            torch.set_flush_denormal(False)


def test_moments_too_small_to_move_a_weight_count_as_zero_in_an_update_and_only_there():
    tiny = 1e-40
    weights = []
    for moment in (0.0, tiny):
        model = trained(FastSAC, 4)
        (state,) = model.critic.optimizer.state.values()
        state["exp_avg"].fill_(moment)
        with reproducible(9):
            model.train(1, 64)
        assert not ((state["exp_avg"] != 0.0) & (state["exp_avg"].abs() < torch.finfo(torch.float32).tiny)).any()
        weights.append(torch.cat([p.detach().reshape(-1) for p in model.policy.parameters()]))
    assert torch.equal(*weights)
    assert float(torch.full((1,), tiny) * 1.0) != 0.0


needs_bfloat16 = pytest.mark.skipif(
    not processor_rounds(),
    reason="no products in bfloat16 on this processor: sac.learner=bf16 is refused here, as tested",
)


def test_a_processor_with_a_matrix_unit_is_never_taken_for_one_without():
    assert processor_rounds() or not torch.cpu._is_amx_tile_supported()


@needs_bfloat16
def test_a_bfloat16_update_goes_where_the_exact_one_goes():
    exact, half = trained(FastSAC, 2, width=128), trained(HalfFastSAC, 2, width=128)
    for ours, theirs in ((half.actor, exact.actor), (half.critic, exact.critic)):
        gradients = [torch.cat([p.grad.reshape(-1) for p in module.parameters()]) for module in (ours, theirs)]
        # Factors of wide layers' products have eight significant bits, everything else 24.
        assert 1e-5 < float((gradients[0] - gradients[1]).norm() / gradients[1].norm()) < 0.02


@needs_bfloat16
def test_rounding_ends_with_the_update():
    trained(HalfFastSAC, 2, width=128)
    nearly_one = torch.full((256, 256), 1.0 + 2.0**-12)
    assert torch.allclose(nearly_one @ nearly_one, torch.full((256, 256), 256.125), rtol=1e-6)


def test_bfloat16_is_refused_where_the_processor_lacks_it(monkeypatch):
    monkeypatch.setattr("algorithms.fast_sac.processor_rounds", lambda: False)
    with pytest.raises(ValueError, match=r"sac\.learner=bf16: no products in bfloat16"):
        trained(HalfFastSAC, 1)


def test_reproducible_leaves_the_global_generators_as_they_were():
    def draw():
        return float(torch.rand(1)), float(np.random.rand()), random.random()

    torch.manual_seed(3)
    np.random.seed(3)
    random.seed(3)
    expected = draw()
    torch.manual_seed(3)
    np.random.seed(3)
    random.seed(3)
    with reproducible(1):
        set_random_seed(1)  # as stable-baselines3's learners do
        draw()
    assert draw() == expected


@pytest.mark.learning
@pytest.mark.parametrize("learner", [FastSAC, pytest.param(HalfFastSAC, marks=needs_bfloat16)])
def test_it_finds_the_optimum_of_a_one_step_task(learner):
    import gymnasium

    class Sign(gymnasium.Env):
        observation_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)

        def reset(self, *, seed=None, options=None):
            super().reset(seed=seed)
            self.state = self.np_random.choice([-1.0, 1.0])
            return np.array([self.state], np.float32), {}

        def step(self, action):
            reward = 1.0 - float((action[0] - 0.5 * self.state) ** 2)
            return np.array([self.state], np.float32), reward, True, False, {}

    model = learner(
        "MlpPolicy", Sign(), learning_starts=100, batch_size=64, learning_rate=1e-3,
        policy_kwargs={"net_arch": [64, 64]}, seed=0, device="cpu",
    )  # fmt: skip
    model.learn(4000)  # the temperature starts at 1, where noise is worth more than the reward
    for state in (-1.0, 1.0):
        action, _ = model.predict(np.array([state], np.float32), deterministic=True)
        assert action[0] == pytest.approx(0.5 * state, abs=0.15)

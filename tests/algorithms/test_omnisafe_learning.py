"""OmniSafe's algorithms through our adapter, on tasks whose answer is known."""

import contextlib
import tempfile

import numpy as np
import pytest
import torch

from algorithms.omnisafe_env import known_to_omnisafe
from algorithms.omnisafe_library import algorithm_defaults, close_logger, omnisafe_module, process_state_kept
from algorithms.omnisafe_settings import Schedule, configuration, settings_of
from algorithms.omnisafe_speed import fast_loops
from algorithms.omnisafe_training import train_actor
from tests.algorithms.omnisafe_toys import (
    BEST_CONSTRAINED,
    BEST_UNCONSTRAINED,
    BOUND,
    COST_LIMIT,
    HORIZON,
    Push,
    single_world_cmdp,
)
from tests.optional import needs_omnisafe

pytestmark = needs_omnisafe
MAIN = ("CPO", "FOCOPS", "TRPOLag")


def toy_configuration(algorithm, schedule, cost_limit=COST_LIMIT, seed=3, **changes):
    """Our settings, with networks of the toy's size."""
    settings = settings_of(algorithm).with_changes(changes)
    chosen = configuration(
        algorithm_defaults(algorithm), settings, schedule, cost_limit=cost_limit, gamma=0.95, seed=seed
    )
    for part in ("actor", "critic"):
        chosen["model_cfgs"][part]["hidden_sizes"] = [32, 32]
    return chosen


def mean_push(network):
    """Mean action over an episode of the deterministic policy."""
    env = Push(1)
    observations, _ = env.reset()
    pushes = []
    for _ in range(HORIZON):
        with torch.no_grad():
            unit = network(torch.as_tensor(observations)).clamp(-1.0, 1.0)
        pushes.append(BOUND * float(unit))
        observations = env.step(BOUND * unit.numpy())[0]
    return float(np.mean(pushes))


@pytest.mark.learning
@pytest.mark.parametrize("algorithm", MAIN)
@pytest.mark.parametrize(
    ("cost_limit", "multiplier", "best"),
    [(COST_LIMIT, "0.4", BEST_CONSTRAINED), (50.0, "0.0", BEST_UNCONSTRAINED)],
    ids=["binding", "slack"],
)
def test_the_constrained_optimum_is_reached(algorithm, cost_limit, multiplier, best):
    changes = {
        "noise_first": "0.25", "noise_last": "0.25", "fisher_decisions": "500", "iterations": "3", "batch": "500",
        "multiplier": multiplier, "multiplier_learning_rate": "0.01", "multiplier_max": "100",
        "actor_learning_rate": "0.001", "kl_limit": "0.01", "temperature": "1.5",
    }  # fmt: skip
    chosen = toy_configuration(algorithm, Schedule(20, 40, 50, 0), cost_limit, **changes)
    network = train_actor(algorithm, Push(20, terminates=True), chosen)
    assert mean_push(network) == pytest.approx(best, abs=0.15)


def trained_by_omnisafe_alone(algorithm, terminates, chosen, folder):
    """OmniSafe's own path: one world, its wrappers, its loops."""
    core = omnisafe_module("omnisafe.envs.core")
    cmdp = single_world_cmdp(core, terminates)
    core.env_register(cmdp)
    own = {**chosen, "logger_cfgs": {**chosen["logger_cfgs"], "log_dir": str(folder)}}
    try:
        with process_state_kept():
            trainer = omnisafe_module().Agent(algorithm, "Push-v0", custom_cfgs=own).agent
            trainer.learn()
            close_logger(trainer.logger)
    finally:
        core.env_unregister(cmdp)
    return trainer._actor_critic.actor.mean[:-1]


@pytest.mark.parametrize("algorithm", MAIN)
@pytest.mark.parametrize("terminates", [True, False], ids=["terminated", "truncated"])
def test_one_world_gives_what_omnisafe_gives_alone_bit_for_bit(algorithm, terminates, tmp_path):
    def chosen(seed):
        return toy_configuration(algorithm, Schedule(1, 2, 12 * HORIZON, 0), seed=seed, batch="20")

    ours = train_actor(algorithm, Push(1, terminates), chosen(7))
    theirs = trained_by_omnisafe_alone(algorithm, terminates, chosen(7), tmp_path)
    other = train_actor(algorithm, Push(1, terminates), chosen(8))
    weights = [torch.cat([p.flatten() for p in network.parameters()]) for network in (ours, theirs, other)]
    assert torch.equal(weights[0], weights[1])
    assert not torch.equal(weights[0], weights[2])


def rolled_out(terminates, worlds, steps):
    """OmniSafe's buffer after one roll-out through the adapter, and the trainer that filled it."""
    vector = Push(worlds, terminates)
    chosen = toy_configuration("CPO", Schedule(worlds, 1, steps, 0))
    with contextlib.ExitStack() as stack:
        stack.enter_context(process_state_kept())
        stack.enter_context(fast_loops())
        name = stack.enter_context(known_to_omnisafe(vector, lambda: None))
        chosen["logger_cfgs"] |= {"log_dir": stack.enter_context(tempfile.TemporaryDirectory())}
        trainer = omnisafe_module().Agent("CPO", name, custom_cfgs=chosen).agent
        trainer._env.rollout(steps, trainer._actor_critic, trainer._buf, trainer.logger)
        close_logger(trainer.logger)
    return trainer


def advantages_by_hand(rewards, values, bootstrap, gamma, gae):
    """Generalized advantage estimates of one path, last decision first."""
    advantage, following, found = 0.0, bootstrap, []
    for reward, value in zip(rewards[::-1], values[::-1], strict=True):
        advantage = reward + gamma * following - value + gamma * gae * advantage
        following = value
        found.append(advantage)
    return np.array(found[::-1])


@pytest.mark.parametrize("terminates", [True, False], ids=["terminated", "truncated"])
def test_termination_is_worth_nothing_truncation_the_final_state_and_a_cut_the_present_one(terminates):
    trainer = rolled_out(terminates, worlds=2, steps=HORIZON + 2)
    gamma, gae = 0.95, settings_of("CPO").gae
    for world, buffer in enumerate(trainer._buf.buffers):
        data = {name: values.numpy().astype(np.float64) for name, values in buffer.data.items()}
        pushes = np.clip(BOUND * data["act"][:, 0], -BOUND, BOUND)
        final = [1.0, 0.1 * pushes[:HORIZON].sum()]  # five decisions old, before the reset
        present = [2 / HORIZON, 0.1 * pushes[HORIZON:].sum()]
        states = torch.tensor([final, present], dtype=torch.float32)
        for letter, critic, signal in (("r", "reward_critic", "reward"), ("c", "cost_critic", "cost")):
            with torch.no_grad():
                at_end, at_cut = getattr(trainer._actor_critic, critic)(states)[0].tolist()
            assert abs(at_end) > 1e-3
            first = slice(0, HORIZON), 0.0 if terminates else at_end
            second = slice(HORIZON, None), at_cut
            for path, bootstrap in (first, second):
                values = data[f"value_{letter}"][path]
                expected = advantages_by_hand(data[signal][path], values, bootstrap, gamma, gae)
                np.testing.assert_allclose(data[f"adv_{letter}"][path], expected, atol=1e-4, err_msg=str(world))
                np.testing.assert_allclose(data[f"target_value_{letter}"][path], expected + values, atol=1e-4)

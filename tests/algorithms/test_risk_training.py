"""Alg. 1: labels of contact at any decision period, the epoch that is kept, the held-out figures."""

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from algorithms.risk_model import RiskArchitecture, RiskModel, RiskModelFileError, RiskNetwork
from algorithms.risk_training import (
    CONTACT,
    RiskSettings,
    Samples,
    collect,
    contact_steps,
    contact_within,
    decisions_ahead,
    fit,
)
from algorithms.scripted_policies import RandomPolicy
from envs.driving_env import ActionMode, DrivingVectorEnv
from envs.scenario import get_scenario
from envs.world import Ending

SIZE = RiskArchitecture(width=8, heads=2, layers=1, hidden=8)


class Rammer(RandomPolicy):
    """Keeps its lane at full throttle, in the driving agent's action: surely hits what is ahead."""

    action_mode = ActionMode.PLANNING

    def act(self, observations):
        return np.tile([2.0, 0.0, 13.89], (len(observations), 1))


def test_contact_within_looks_three_seconds_ahead_and_not_into_the_next_episode():
    # Decisions of 1 s. World 0: contact at the end of decision 4. World 1: an episode ends without contact at 1, the
    # next in contact at 3.
    contacts = np.zeros((6, 2), int)
    contacts[4, 0] = contacts[3, 1] = 10
    ends = contacts > 0
    ends[1, 1] = True
    within = contact_within(contacts, ends, 10)
    assert within[:, 0].tolist() == [False, False, True, True, True, False]
    assert within[:, 1].tolist() == [False, False, True, True, False, False]


@pytest.mark.parametrize(("step", "marked"), [(2, 8), (3, 7)])
def test_contact_is_counted_in_steps_where_decisions_do_not_divide_three_seconds(step, marked):
    # Decisions of 0.4 s: 7 whole ones and 0.2 s of an eighth; contact at 3.0 s, then at 3.1 s.
    contacts = np.zeros((8, 1), int)
    contacts[7, 0] = step
    assert contact_within(contacts, contacts > 0, 4).sum() == marked


@pytest.mark.parametrize(
    ("period", "decisions"), [(0.1, 30), (0.3, 10), (0.4, 8), (0.5, 6), (0.7, 5), (1.0, 3), (2.0, 2), (10.0, 1)]
)
def test_no_label_looks_less_than_three_seconds_ahead(period, decisions):
    assert decisions_ahead(get_scenario(f"a:decision_period_s={period}")) == decisions


@pytest.mark.parametrize("period", [0.4, 0.5, 0.7])
def test_labels_are_what_the_records_of_finished_episodes_say(period):
    scenario = get_scenario(f"a:decision_period_s={period}")
    env = DrivingVectorEnv(scenario, 8, action_mode=ActionMode.PLANNING, comfort=False)
    observations, _ = env.reset(seed=1)
    before, contacts, ends = [], [], []
    while env.episodes_done < 24:
        before.append(env.world.episode[["episode", "steps"]].copy())
        observations, _, terminated, truncated, info = env.step(Rammer().act(observations))
        ends.append(terminated | truncated)
        contacts.append(contact_steps(info, ends[-1], scenario.substeps))
    within = contact_within(np.array(contacts), np.array(ends), scenario.substeps)
    last = {row["episode"]: row for row in env.finished_episodes()}
    known = [
        (mark, *scene)
        for row, marks in zip(before, within, strict=True)
        for scene, mark in zip(row, marks, strict=True)
    ]
    known = [(mark, last[episode], steps) for mark, episode, steps in known if episode in last]
    assert 24 * 4 < sum(mark for mark, *_ in known) < len(known)
    for mark, episode, steps in known:
        assert mark == (episode["ending"] == Ending.COLLISION and episode["steps"] - steps <= 30)


def test_decisions_longer_than_three_seconds_have_a_label_each():
    found = collect(Rammer(), get_scenario("a:decision_period_s=10.0"), RiskSettings(samples=1_000, label=CONTACT))
    assert len(found.labels) == len(found.observations) == len(found.held_out) == 1_000


def noise(count, seed=0):
    rng = np.random.default_rng(seed)
    observations = rng.random((count, 47)).astype(np.float32)
    observations[:, 39:] = 1.0
    return rng, observations


def test_the_best_epoch_is_kept_and_training_ends_when_none_has_been_better():
    rng, observations = noise(600)
    labels = (2.0 * observations[:, 0] + rng.normal(size=600)).astype(np.float32)
    samples = Samples(observations, labels, np.arange(600) % 4 == 0)
    settings = RiskSettings(batch=32, epochs=50, patience=3, learning_rate=1e-2)
    network, figures = fit(samples, settings, SIZE, lambda _: None)
    errors = [point["loss_held_out"] for point in figures["curve"]]
    best = int(np.argmin(errors))
    assert 0 < best == len(errors) - 1 - settings.patience
    assert errors[-1] > 1.01 * errors[best]
    assert figures["mse_held_out"] == pytest.approx(errors[best], rel=1e-5)
    with torch.no_grad():
        value = network(torch.from_numpy(observations[samples.held_out]))[0].numpy()
    assert np.mean((value - samples.labels[samples.held_out]) ** 2) == pytest.approx(errors[best], rel=1e-5)


def test_the_area_under_the_curve_is_the_share_of_pairs_in_which_contact_ranks_above():
    rng, observations = noise(800)
    labels = (observations[:, 0] + 0.1 * rng.normal(size=800) > 0.7).astype(np.float32)
    samples = Samples(observations, labels, np.arange(800) % 4 == 0)
    network, figures = fit(samples, RiskSettings(batch=32, epochs=8, label=CONTACT), SIZE, lambda _: None)
    with torch.no_grad():
        value = network(torch.from_numpy(observations[samples.held_out]))[0].numpy()
    hit = labels[samples.held_out] > 0.5
    pairs = value[hit][:, None] - value[~hit][None, :]
    assert figures["auc_held_out"] == pytest.approx(np.mean((pairs > 0.0) + 0.5 * (pairs == 0.0)))
    assert figures["auc_held_out"] > 0.8


def test_a_training_that_never_had_a_finite_error_is_no_model():
    _, observations = noise(64)
    samples = Samples(observations, np.full(64, np.nan, np.float32), np.arange(64) % 4 == 0)
    with pytest.raises(FloatingPointError, match="nan after every one of 4 epochs"):
        fit(samples, RiskSettings(batch=32), SIZE, lambda _: None)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_weights_that_are_not_finite_are_refused_by_name(tmp_path, value):
    RiskModel(RiskNetwork(SIZE), SIZE, {"scenario": "a-v1"}).save(tmp_path)
    weights = load_file(tmp_path / "risk.safetensors")
    weights["head.weight"][0, 3] = value
    save_file(weights, tmp_path / "risk.safetensors")
    with pytest.raises(RiskModelFileError, match=r"'head\.weight' are not all finite"):
        RiskModel.load(tmp_path, "a-v1")

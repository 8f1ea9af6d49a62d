"""The risk model: tokens, masks, attention, RQ, files that execute nothing."""

import json
import pickle

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from algorithms.risk_kernel import rank_objects_by
from algorithms.risk_model import (
    RiskArchitecture,
    RiskModel,
    RiskModelFileError,
    RiskNetwork,
    adjustment_time,
    risk_percent,
    tokenise,
)
from algorithms.risk_training import RiskSettings, Samples, fit, shuffled_values
from envs.driving_env import DrivingVectorEnv


@pytest.fixture(scope="module")
def observations():
    env = DrivingVectorEnv("b", 32)
    seen = [env.reset(seed=1)[0]]
    rng = np.random.default_rng(0)
    for _ in range(30):
        seen.append(env.step(rng.uniform([-3.5, -2.0], [3.5, 2.0], (32, 2)))[0])
    return np.concatenate(seen)


@pytest.fixture
def model():
    torch.manual_seed(0)
    size = RiskArchitecture()
    return RiskModel(RiskNetwork(size), size, {"scenario": "b-v1", "value_quantiles": [1.0, 2.0, 4.0]})


@given(st.floats(0.5, 4.0))
def test_risk_and_its_linearisation_give_back_the_planning_time(phi):
    # RQ = 100 (4 - phi) / 3.5; T_c = 4 - 7/200 RQ = 4 - (4 - phi).
    assert adjustment_time(risk_percent(np.array([phi])))[0] == pytest.approx(phi, abs=1e-12)


def test_risk_grows_as_the_planning_time_shrinks_and_the_printed_formula_has_the_opposite_sign():
    assert risk_percent(np.array([0.5, 4.0, 9.0])).tolist() == [100.0, 0.0, 0.0]
    assert adjustment_time(risk_percent(np.array([1.0]), printed=True))[0] == pytest.approx(3.5)


def test_pedestrian_features_take_the_places_of_the_same_quantities():
    x = torch.zeros(1, 47)
    x[0, 30:33] = torch.tensor([0.1, 0.2, -1.3])
    x[0, 44] = 1.0
    tokens, present = tokenise(x)
    assert tokens[0, 6].tolist() == pytest.approx([0.1, 0.2, 0.0, -1.3, 0.0])
    assert present[0].tolist() == [True, False, False, False, False, False, True, False, False]


def test_importance_sums_to_one_over_present_objects_and_is_zero_elsewhere(model, observations):
    importance = model(observations).importance
    present = observations[:, 39:47] > 0.5
    assert present.any()
    assert not present.all()
    assert (importance[~present] == 0.0).all()
    assert np.allclose(importance.sum(1)[present.any(1)], 1.0)


def test_importance_is_the_attention_to_the_present_renormalised():
    # The ego's own 0.5 is left out: 0.1 and 0.4 of slots 2 and 6.
    ranks = np.full(8, np.nan)
    rank_objects_by(np.array([0.5, 0.1, 0.4, 9.0], np.float32), 3, np.array([-1, 2, 6, 0]), ranks)
    assert ranks == pytest.approx([0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.8, 0.0])


def test_where_the_ego_attends_to_itself_alone_present_objects_share_equally(observations):
    ranks = np.full(8, np.nan)
    rank_objects_by(np.array([1.0, 0.0, 0.0], np.float32), 3, np.array([-1, 2, 6]), ranks)
    assert ranks.tolist() == [0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.5, 0.0]
    torch.manual_seed(0)
    size = RiskArchitecture()
    network = RiskNetwork(size)
    with torch.no_grad():
        network.blocks[-1].query_key_value.weight *= 1000.0
    importance, present = RiskModel(network, size, {})(observations).importance, observations[:, 39:47] > 0.5
    assert np.allclose(importance.sum(1), present.any(1))
    equal = present / np.maximum(present.sum(1, keepdims=True), 1)
    assert (np.abs(importance - equal).max(1)[present.sum(1) > 1] < 1e-6).sum() > 100


@pytest.mark.parametrize("size", [RiskArchitecture(), RiskArchitecture(width=8, heads=2, layers=3, hidden=12)])
def test_the_compiled_network_is_the_plain_one(size, observations):
    torch.manual_seed(1)
    network = RiskNetwork(size)
    observations = np.concatenate([observations, np.zeros((1, 47), np.float32)])
    with torch.no_grad():
        for parameter in network.parameters():
            parameter += 0.3 * torch.randn_like(parameter)
        value, weights = network(torch.from_numpy(observations))
    present = observations[:, 39:47] > 0.5
    importance = weights.mean(1)[:, 0, 1:].detach().numpy() * present
    importance /= np.maximum(importance.sum(1, keepdims=True), 1e-9)
    output = RiskModel(network, size, {})(observations)
    assert value.std() > 0.1
    assert np.allclose(output.value, value.detach().numpy(), rtol=0.0, atol=1e-5)
    assert np.allclose(output.importance, importance, rtol=0.0, atol=1e-5)


def test_a_scene_has_the_same_output_alone_and_among_others(model, observations):
    together, alone = model(observations[:64]), [model(row[None]) for row in observations[:64]]
    assert np.array_equal(together.value, np.concatenate([one.value for one in alone]))
    assert np.array_equal(together.importance, np.concatenate([one.importance for one in alone]))


def test_sizes_that_the_compiled_network_cannot_take_are_refused():
    for sizes in ({"width": 30, "heads": 2}, {"width": 32, "heads": 3}, {"hidden": 65}):
        with pytest.raises(ValueError, match="multiples of 4"):
            RiskArchitecture(**sizes)


def test_absent_objects_cannot_influence_the_value(model, observations):
    changed = observations.copy()
    slots = np.repeat(changed[:, 39:44] < 0.5, 5, axis=1)
    changed[:, 5:30][slots] = 7.0
    assert np.array_equal(model(changed).value, model(observations).value)


def test_present_objects_of_a_kind_may_stand_in_any_order(model, observations):
    full = observations[(observations[:, 39:44] > 0.5).all(1)][:20]
    swapped = full.copy()
    swapped[:, 5:10], swapped[:, 10:15] = full[:, 10:15], full[:, 5:10]
    assert np.allclose(model(swapped).value, model(full).value, atol=1e-5)


def test_training_finds_a_function_of_the_scene(observations):
    # Known optimum: the label is the ego's speed plus the distance of the nearest car.
    labels = (2.0 * observations[:, 2] + 5.0 * observations[:, 5]).astype(np.float32)
    samples = Samples(observations, labels, np.arange(len(labels)) % 10 == 0)
    _, figures = fit(samples, RiskSettings(epochs=40, batch=64, patience=40), RiskArchitecture(), lambda _text: None)
    assert figures["r2_held_out"] > 0.9
    again = fit(samples, RiskSettings(epochs=2, batch=64), RiskArchitecture(), lambda _text: None)[1]
    assert again == fit(samples, RiskSettings(epochs=2, batch=64), RiskArchitecture(), lambda _text: None)[1]


def test_save_and_load_agree(model, observations, tmp_path):
    model.save(tmp_path)
    loaded = RiskModel.load(tmp_path, "b-v1")
    assert np.array_equal(loaded(observations).value, model(observations).value)


def test_a_model_of_another_scenario_or_layout_is_refused_by_name(model, tmp_path):
    model.save(tmp_path)
    with pytest.raises(RiskModelFileError, match=r"'b-v1'.*'a-v1'"):
        RiskModel.load(tmp_path, "a-v1")
    text = json.loads((tmp_path / "risk.json").read_text())
    (tmp_path / "risk.json").write_text(json.dumps(text | {"layout_version": 99}))
    with pytest.raises(RiskModelFileError, match="99"):
        RiskModel.load(tmp_path, "b-v1")


def test_a_pickle_under_our_name_is_refused_without_running_it(model, tmp_path):
    class Hostile:
        def __reduce__(self):
            return (tmp_path.joinpath("owned").touch, ())

    model.save(tmp_path)
    (tmp_path / "risk.safetensors").write_bytes(pickle.dumps(Hostile()))
    with pytest.raises(RiskModelFileError, match="not a readable risk model"):
        RiskModel.load(tmp_path)
    assert not (tmp_path / "owned").exists()


def test_shuffled_values_follow_the_models_distribution(model):
    draws = np.random.default_rng(0).random(20_000)
    values = shuffled_values(model, draws)
    # Quantiles 1, 2, 4: half of the mass uniform on [1, 2], half on [2, 4]; mean 0.5 * 1.5 + 0.5 * 3.
    assert values.mean() == pytest.approx(2.25, abs=0.02)
    assert values.min() >= 1.0
    assert values.max() <= 4.0

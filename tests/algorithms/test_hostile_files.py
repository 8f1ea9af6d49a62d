"""Policies and risk models load without executing code: a pickle under our names is refused unread."""

import os
import pickle

import pytest
import torch

from algorithms.networks import Architecture, NetworkPolicy, PolicyFileError
from algorithms.risk_model import RiskArchitecture, RiskModel, RiskModelFileError, RiskNetwork


class Hostile:
    """Makes a folder when it is unpickled."""

    def __init__(self, sign):
        self.sign = sign

    def __reduce__(self):
        return os.mkdir, (str(self.sign),)


def hostile_bytes(kind, sign, path):
    if kind == "pickle":
        path.write_bytes(pickle.dumps(Hostile(sign)))
    else:
        torch.save({"weight": Hostile(sign)}, path)


@pytest.mark.parametrize("kind", ["pickle", "torch"])
@pytest.mark.parametrize("name", ["actor.safetensors", "actor.json"])
def test_a_hostile_policy_is_refused_unread(tmp_path, kind, name):
    architecture = Architecture((47, 8, 2), "relu", squashed=True)
    NetworkPolicy(architecture, architecture.build()).save(tmp_path)
    NetworkPolicy.load(tmp_path)
    hostile_bytes(kind, tmp_path / "executed", tmp_path / name)
    with pytest.raises(PolicyFileError, match="not a readable policy"):
        NetworkPolicy.load(tmp_path)
    assert not (tmp_path / "executed").exists()


@pytest.mark.parametrize("kind", ["pickle", "torch"])
@pytest.mark.parametrize("name", ["risk.safetensors", "risk.json"])
def test_a_hostile_risk_model_is_refused_unread(tmp_path, kind, name):
    size = RiskArchitecture()
    RiskModel(RiskNetwork(size), size, {"scenario": "a-v1"}).save(tmp_path)
    RiskModel.load(tmp_path, "a-v1")
    hostile_bytes(kind, tmp_path / "executed", tmp_path / name)
    with pytest.raises(RiskModelFileError, match="not a readable risk model"):
        RiskModel.load(tmp_path, "a-v1")
    assert not (tmp_path / "executed").exists()


@pytest.mark.parametrize("kind", ["pickle", "torch"])
def test_the_hostile_files_would_have_acted_had_they_been_unpickled(tmp_path, kind):
    hostile_bytes(kind, tmp_path / "executed", tmp_path / "file")
    if kind == "pickle":
        pickle.loads((tmp_path / "file").read_bytes())
    else:
        torch.load(tmp_path / "file", weights_only=False)
    assert (tmp_path / "executed").is_dir()

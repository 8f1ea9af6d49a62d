"""Loads OmniSafe and compiled kernels when it is imported: for processes that are forked many times."""

import contextlib

import numpy as np

from algorithms.omnisafe_library import omnisafe_module
from algorithms.registry import UnavailableMethodError
from algorithms.risk_guard import RiskGuard
from algorithms.risk_model import RiskArchitecture, RiskModel, RiskNetwork
from envs.driving_env import DrivingVectorEnv

_SIZE = RiskArchitecture()
for _shield in (None, RiskGuard(RiskModel(RiskNetwork(_SIZE), _SIZE, {}))):
    _env = DrivingVectorEnv("a", 2, shield=_shield)
    _env.reset(seed=0)
    for _ in range(3):
        _env.step(np.zeros((2, 2)))
with contextlib.suppress(UnavailableMethodError):
    omnisafe_module()

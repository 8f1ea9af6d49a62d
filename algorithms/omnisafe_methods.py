"""CPO, FOCOPS, TRPO-Lag and the other on-policy algorithms of OmniSafe 0.5.0, on our scenarios."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

from algorithms.method import Method, Policy, Task
from algorithms.omnisafe_library import require_omnisafe
from algorithms.omnisafe_settings import SETTING_NAMES, settings_of
from envs.scenario import UnknownNameError

ALGORITHMS: Final = (
    "CPO", "CPPOPID", "CUP", "FOCOPS", "IPO", "NaturalPG", "OnCRPO", "P3O", "PCPO", "PDO", "PPO", "PPOLag",
    "PolicyGradient", "RCPO", "TRPO", "TRPOLag", "TRPOPID",
)  # fmt: skip
"""OmniSafe's on-policy algorithms but for Saute, Simmer and EarlyTerminated: those change observation or episode."""

UNCONSTRAINED: Final = ("NaturalPG", "PPO", "PolicyGradient", "TRPO")


class OnPolicyMethod(Method):
    """What the methods here share.

    Attributes:
        algorithm: Name in OmniSafe.
    """

    version = 2
    setting_names = SETTING_NAMES
    bounds_cost = True
    algorithm: str

    @classmethod
    def check_available(cls) -> None:
        """Raise `algorithms.registry.UnavailableMethodError` where OmniSafe is not installed."""
        require_omnisafe()

    def check_settings(self, settings: Mapping[str, str]) -> None:
        """Refuse what the algorithm cannot use."""
        settings_of(self.algorithm).with_changes(settings)

    def train(self, task: Task) -> Policy:
        """Train on the environment's reward under its cost contract."""
        from algorithms.omnisafe_training import train

        return train(self.algorithm, task)

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The saved actor."""
        from algorithms.networks import NetworkPolicy

        return NetworkPolicy.load(folder)


class CPO(OnPolicyMethod):
    """Constrained policy optimization (Achiam et al. 2017)."""

    algorithm = "CPO"


class FOCOPS(OnPolicyMethod):
    """First-order constrained optimization in policy space (Zhang et al. 2020)."""

    version = 3
    algorithm = "FOCOPS"


class TRPOLag(OnPolicyMethod):
    """Trust-region policy optimization with a Lagrange multiplier (Ray et al. 2019)."""

    version = 4
    algorithm = "TRPOLag"


class OmniSafe(OnPolicyMethod):
    """Any on-policy algorithm of OmniSafe: ``omnisafe:algo=PCPO``."""

    version = 3
    defaults: ClassVar[dict[str, Any]] = {"algo": "PCPO"}

    def __init__(self, **parameters: Any) -> None:
        """Take parameters over the defaults.

        Raises:
            UnknownNameError: OmniSafe has no such algorithm, or it cannot run on our scenarios.
        """
        super().__init__(**parameters)
        self.algorithm = str(self.parameters["algo"])
        if self.algorithm not in ALGORITHMS:
            raise UnknownNameError("OmniSafe algorithm", self.algorithm, list(ALGORITHMS))
        self.bounds_cost = self.algorithm not in UNCONSTRAINED

"""DD-RQ and its ablation: SAC behind a guard whose T_c is fixed, or set by the risk model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

from algorithms.guard_demand import require_horizon, require_share
from algorithms.guard_options import GuardOptions
from algorithms.method import Method, Policy, Task
from algorithms.sac import SETTING_NAMES, SACSettings
from algorithms.versions import GUARD_VERSION, LEARNER_VERSION, STEERED_VERSION

if TYPE_CHECKING:
    from algorithms.safety_guard import SafetyGuard

AGENT_STEPS_MAX: Final = 500_000
"""The driving agent gets the run's own budget, at most this many simulation steps."""
TC_SOURCES: Final = ("model", "mean")
RQ_SOURCES: Final = ("model", "shuffled", "printed")


class FixedGuard(Method):
    """SAC behind the safety guard with a fixed T_c (``safety-guard:tc=3.0``).

    ``share=0.5`` demands half of S_safe, ``reserve=false`` switches the braking reserve off, ``aware=true`` shows
    the policy the guard's limits. ``literal=true`` sets the four ``literal_...`` options of `GuardOptions`, no other:
    `hold`, `give_way`, `turned_body` and `excursion` stay on, and so does `reserve` unless it is switched off, too.
    """

    version = GUARD_VERSION + LEARNER_VERSION
    defaults: ClassVar[dict[str, Any]] = {"tc": 3.0, "share": 1.0, "reserve": True, "literal": False, "aware": False}
    setting_names = SETTING_NAMES

    def shield(self) -> SafetyGuard:
        """The guard of these parameters."""
        from algorithms.safety_guard import SafetyGuard

        literal = self.parameters["literal"]
        options = GuardOptions(literal, literal, literal, literal, self.parameters["reserve"])
        return SafetyGuard(self.parameters["tc"], options, self.parameters["share"])

    def __init__(self, **parameters: Any) -> None:
        """Check T_c and share at once, not when training begins."""
        super().__init__(**parameters)
        require_horizon(self.parameters["tc"])
        require_share(self.parameters["share"])

    def check_settings(self, settings: Mapping[str, str]) -> None:
        """Refuse what the learner cannot use."""
        SACSettings.from_settings(settings)

    def train(self, task: Task) -> Policy:
        """Train with the guard between policy and world; r_risk is paid where it intervenes."""
        from algorithms.guard_features import features_of
        from algorithms.sac_training import train_sac

        shield = self.shield()
        return train_sac(task, shield, features=features_of(shield, self.parameters["aware"]))

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The saved actor behind the same guard."""
        from algorithms.guard_features import features_of
        from algorithms.networks import NetworkPolicy

        shield = self.shield()
        return NetworkPolicy.load(folder, shield, features_of(shield, self.parameters["aware"]))


class DDRQ(Method):
    """The paper's method: SAC behind the adjustable guard; its controls are parameters.

    ``tc=mean``: constant mean T_c. ``rq=shuffled``: RQ drawn from its own distribution, without relation to the
    scene. ``rq=printed``: RQ as the paper prints it, T_c = 4.5 - phi. ``aware=true`` shows the policy the guard's
    limits, which the paper does not.
    """

    version = STEERED_VERSION
    defaults: ClassVar[dict[str, Any]] = {"tc": "model", "rq": "model", "aware": False}
    setting_names = SETTING_NAMES

    def __init__(self, **parameters: Any) -> None:
        """Check the choices.

        Raises:
            ValueError: A choice is unknown.
        """
        super().__init__(**parameters)
        for key, known in (("tc", TC_SOURCES), ("rq", RQ_SOURCES)):
            if self.parameters[key] not in known:
                raise ValueError(f"{self.name}:{key} = {self.parameters[key]!r}: must be one of {', '.join(known)}.")

    def check_settings(self, settings: Mapping[str, str]) -> None:
        """Refuse what the learner cannot use."""
        SACSettings.from_settings(settings)

    def train(self, task: Task) -> Policy:
        """Train or fetch driving agent and risk model, then train behind the guard that they steer."""
        from algorithms.guard_features import features_of
        from algorithms.risk_guard import RiskGuard, RiskGuardedPolicy
        from algorithms.risk_training import risk_model
        from algorithms.sac_training import train_sac

        SACSettings.for_task(task)  # refused now rather than after the other two trainings
        model = risk_model(task.scenario, min(task.budget.steps, AGENT_STEPS_MAX), task.cache, making=task.making)
        shield = RiskGuard(model, self.parameters["tc"], self.parameters["rq"])
        shield.begin(task.stream("shield"))
        features = features_of(shield, self.parameters["aware"])
        return RiskGuardedPolicy.of(train_sac(task, shield, features=features))

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The saved actor behind the saved risk model."""
        from algorithms.guard_features import features_of
        from algorithms.risk_guard import RiskGuard, RiskGuardedPolicy
        from algorithms.risk_model import RiskModel

        shield = RiskGuard(RiskModel.load(folder, task.scenario.id), self.parameters["tc"], self.parameters["rq"])
        return RiskGuardedPolicy.load(folder, shield, features_of(shield, self.parameters["aware"]))

"""DD-RQ-plus: the guard demands S_safe in proportion to the risk, learnt from outcomes, and the policy sees its limits.

The paper defines risk as a function of state and agent, but clones it from a planning time that nothing in the
agent's reward pays for. Here RQ is the probability that the driving agent has contact within 3 s, learnt from its own
roll-outs, and the guard demands that share of S_safe: a_safe = 2 (dS - sign(dS) RQ S_safe + T_c dv) / T_c^2.

The policy is aware of the guard: its observation ends in the limits that this demand leaves
(`algorithms.guard_features`).

Safety does not rest on RQ: the braking reserve (`algorithms.critical_acceleration.stopping_bound`) holds at any share.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

from algorithms.dd_rq import AGENT_STEPS_MAX
from algorithms.guard_demand import require_horizon
from algorithms.method import Method, Policy, Task
from algorithms.sac import SETTING_NAMES, SACSettings
from algorithms.versions import STEERED_VERSION

if TYPE_CHECKING:
    from algorithms.risk_guard import ShareGuard
    from algorithms.risk_model import RiskModel

SHARE_SOURCES: Final = ("risk", "mean", "shuffled")


class DDRQPlus(Method):
    """SAC behind the guard that demands S_safe in proportion to the risk; its controls are parameters.

    ``share=mean``: the constant mean of RQ. ``share=shuffled``: RQ drawn from its own distribution, without relation
    to the scene. ``aware=false``: the policy is not shown the guard's limits. ``safety-guard:share=0.5`` demands a
    constant share, with ``aware=true`` of a policy that is shown the limits.
    """

    version = STEERED_VERSION + 1
    defaults: ClassVar[dict[str, Any]] = {"tc": 3.0, "share": "risk", "aware": True}
    setting_names = SETTING_NAMES

    def __init__(self, **parameters: Any) -> None:
        """Check the choices.

        Raises:
            ValueError: T_c is not positive, or the source of the share is unknown.
        """
        super().__init__(**parameters)
        require_horizon(self.parameters["tc"])
        if self.parameters["share"] not in SHARE_SOURCES:
            known = ", ".join(SHARE_SOURCES)
            raise ValueError(f"{self.name}:share = {self.parameters['share']!r}: must be one of {known}.")

    def shield(self, model: RiskModel) -> ShareGuard:
        """The guard of these parameters."""
        from algorithms.risk_guard import ShareGuard

        return ShareGuard(model, self.parameters["tc"], self.parameters["share"])

    def check_settings(self, settings: Mapping[str, str]) -> None:
        """Refuse what the learner cannot use."""
        SACSettings.from_settings(settings)

    def train(self, task: Task) -> Policy:
        """Train or fetch driving agent and model of contact, then train behind the guard that they steer."""
        from algorithms.guard_features import features_of
        from algorithms.risk_guard import RiskGuardedPolicy
        from algorithms.risk_training import CONTACT, RiskSettings, risk_model
        from algorithms.sac_training import train_sac

        SACSettings.for_task(task)  # refused now rather than after the other two trainings
        steps = min(task.budget.steps, AGENT_STEPS_MAX)
        model = risk_model(task.scenario, steps, task.cache, RiskSettings.for_agent(steps, CONTACT), task.making)
        shield = self.shield(model)
        shield.begin(task.stream("shield"))
        features = features_of(shield, self.parameters["aware"])
        return RiskGuardedPolicy.of(train_sac(task, shield, features=features))

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The saved actor behind the saved model of contact."""
        from algorithms.guard_features import features_of
        from algorithms.risk_guard import RiskGuardedPolicy
        from algorithms.risk_model import RiskModel

        shield = self.shield(RiskModel.load(folder, task.scenario.id))
        return RiskGuardedPolicy.load(folder, shield, features_of(shield, self.parameters["aware"]))

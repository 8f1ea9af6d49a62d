"""DD-RQ-plus: the guard demands S_safe in proportion to the risk, learnt from outcomes instead of from T_c.

The paper defines risk as a function of state and agent, but clones it from a planning time that nothing in the
agent's reward pays for. Here RQ is the probability that the driving agent has contact within 3 s, learnt from its own
roll-outs, and the guard demands that share of S_safe: a_safe = 2 (dS - sign(dS) RQ S_safe + T_c dv) / T_c^2.

Safety does not rest on RQ: the braking reserve (`algorithms.critical_acceleration.stopping_bound`) holds at any share.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from scipy import special

from algorithms.dd_rq import AGENT_STEPS_MAX, RiskGuard, RiskGuardedPolicy
from algorithms.method import Method, Observations, Policy, Task
from algorithms.networks import NetworkPolicy
from algorithms.risk_model import RiskModel
from algorithms.risk_training import CONTACT, RiskSettings, risk_model, shuffled_values
from algorithms.sac import LEARNER_VERSION, SETTING_NAMES, SACSettings, train_sac
from algorithms.safety_guard import GUARD_VERSION, require_horizon
from envs.world import FloatArray, World

SHARE_SOURCES: Final = ("risk", "mean", "shuffled")


class ShareGuard(RiskGuard):
    """Alg. 2 with fixed T_c that demands the share RQ of S_safe, refreshed at every decision.

    Attributes:
        risk: RQ of the last decision, the probability of contact within 3 s, shape (N,) [%].
    """

    def __init__(self, model: RiskModel, tc: float = 3.0, share: str = "risk") -> None:
        """Steer by a model of contact, or by one of its controls: its constant mean, or RQ shuffled."""
        super().__init__(model)
        self.tc = require_horizon(tc)
        self._share_source = share

    def observe(self, observations: Observations) -> None:
        """RQ and IR of every world, held until the next decision."""
        output = self.model(observations)
        probability = special.expit(output.value)
        if self._share_source == "mean":
            probability = np.full(len(probability), float(self.model.description["value_mean"]))
        if self._share_source == "shuffled":
            probability = shuffled_values(self.model, self._rng.random(len(probability)))
        self.risk = 100.0 * probability
        self._horizons = np.full(len(probability), self.tc)
        self._by_slot = output.importance
        self._by_object = None

    def shares(self, world: World) -> FloatArray:
        """Demanded part of S_safe in every world, (N,) in [0, 1]."""
        return 0.01 * self.risk


class DDRQPlus(Method):
    """SAC behind the guard that demands S_safe in proportion to the risk; its controls are parameters.

    ``share=mean``: the constant mean of RQ. ``share=shuffled``: RQ drawn from its own distribution, without relation
    to the scene. ``safety-guard:share=0.5`` demands a constant share.
    """

    version = GUARD_VERSION + LEARNER_VERSION
    defaults: ClassVar[dict[str, Any]] = {"tc": 3.0, "share": "risk"}
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
        return ShareGuard(model, self.parameters["tc"], self.parameters["share"])

    def check_settings(self, settings: Mapping[str, str]) -> None:
        """Refuse what the learner cannot use."""
        SACSettings.from_settings(settings)

    def train(self, task: Task) -> Policy:
        """Train or fetch driving agent and model of contact, then train behind the guard that they steer."""
        steps = min(task.budget.steps, AGENT_STEPS_MAX)
        model = risk_model(task.scenario, steps, task.cache, RiskSettings.for_agent(steps, CONTACT), task.making)
        shield = self.shield(model)
        shield.begin(task.stream("shield"))
        trained = train_sac(task, shield)
        return RiskGuardedPolicy(trained.architecture, trained.network, trained.action_mode, shield)

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The saved actor behind the saved model of contact."""
        shield = self.shield(RiskModel.load(folder, task.scenario.id))
        loaded = NetworkPolicy.load(folder, shield)
        return RiskGuardedPolicy(loaded.architecture, loaded.network, loaded.action_mode, shield)

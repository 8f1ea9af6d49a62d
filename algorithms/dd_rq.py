"""DD-RQ and its ablation: SAC behind a guard whose T_c is fixed, or set by the risk model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from algorithms.driving_agent import VERSION as AGENT_VERSION
from algorithms.guard_demand import Demand, require_horizon, require_share
from algorithms.guard_features import features_of
from algorithms.guard_options import GuardOptions
from algorithms.method import Method, Observations, Policy, Task
from algorithms.networks import NetworkPolicy
from algorithms.risk_model import RiskModel, RiskOutput, adjustment_time, risk_percent
from algorithms.risk_training import VERSION as MODEL_VERSION
from algorithms.risk_training import risk_model, shuffled_values, unrelated_draws
from algorithms.sac import LEARNER_VERSION, SETTING_NAMES, SACSettings, train_sac
from algorithms.safety_guard import GUARD_VERSION, SafetyGuard
from envs.compiled import borrowed, njit
from envs.observation import EMPTY, rank_objects
from envs.scenario import PEDESTRIAN_SLOTS, VEHICLE_SLOTS
from envs.world import FloatArray, Records, World

AGENT_STEPS_MAX: Final = 500_000
"""The driving agent gets the run's own budget, at most this many simulation steps."""
STEERED_VERSION: Final = GUARD_VERSION + AGENT_VERSION + MODEL_VERSION
"""Of SAC behind a guard that a risk model steers: rises with guard, learner (in the agent's), agent and model."""
TC_SOURCES: Final = ("model", "mean")
RQ_SOURCES: Final = ("model", "shuffled", "printed")


@njit
def place_importance(
    ego: Records, vehicles: Records, pedestrians: Records, by_slot: FloatArray, by_object: FloatArray
) -> None:
    """Carry IR from observation slots (N, 8) to vehicles and pedestrians (N, V + P)."""
    ego, vehicles, pedestrians = borrowed(ego), borrowed(vehicles), borrowed(pedestrians)
    slots = np.empty(VEHICLE_SLOTS + PEDESTRIAN_SLOTS, np.int64)
    keys = np.empty(VEHICLE_SLOTS + PEDESTRIAN_SLOTS, np.float64)
    by_object[:] = 0.0
    for i in range(ego.shape[0]):
        rank_objects(ego, vehicles, pedestrians, i, slots, keys)
        for slot in range(VEHICLE_SLOTS + PEDESTRIAN_SLOTS):
            if slots[slot] != EMPTY:
                offset = 0 if slot < VEHICLE_SLOTS else vehicles.shape[1]
                by_object[i, offset + slots[slot]] = by_slot[i, slot]


class RiskGuard(SafetyGuard):
    """Alg. 2 with T_c = k1 RQ + b1 of the risk model, refreshed at every decision.

    Attributes:
        model: The risk model.
        risk: RQ of the last decision, shape (N,) [%].
    """

    def __init__(
        self, model: RiskModel, tc: str = "model", rq: str = "model", options: GuardOptions | None = None
    ) -> None:
        """Steer by the model, or by one of its controls: constant mean T_c, RQ shuffled, RQ as printed."""
        super().__init__(options=options)
        self.model = model
        self.risk = np.zeros(0)
        self._tc_source, self._rq_source = tc, rq
        self._salt = b""
        self._asked: Observations | None = None
        self._held = Demand(np.zeros(0), np.zeros(0), np.zeros((0, VEHICLE_SLOTS + PEDESTRIAN_SLOTS)))
        self._answered = self._held, self.risk
        self._by_object: FloatArray | None = None

    def begin(self, seed: np.random.SeedSequence) -> None:
        """Seed the shuffled control."""
        self._salt = seed.generate_state(2).tobytes()
        self._asked = None

    def observe(self, observations: Observations) -> None:
        """RQ and IR of every world, held until the next decision."""
        self.demand(observations)
        self._held, self.risk = self._answered
        self._by_object = None

    def demand(self, observations: Observations) -> Demand:
        """What it will ask for; kept, as an aware policy asks for it just before the guard does."""
        if self._asked is None or not np.array_equal(self._asked, observations):
            self._answered = self._answer(observations, self.model(observations))
            self._asked = observations.copy()
        return self._answered[0]

    def _answer(self, observations: Observations, output: RiskOutput) -> tuple[Demand, FloatArray]:
        """What to ask for, and RQ (N,) [%], given what the model says."""
        phi = output.value
        if self._tc_source == "mean":
            phi = np.full(len(phi), float(self.model.description["value_mean"]))
        if self._rq_source == "shuffled":
            phi = self._shuffled(observations)
        risk = risk_percent(phi, printed=self._rq_source == "printed")
        return Demand(adjustment_time(risk), np.full(len(phi), self.share), output.importance), risk

    def _shuffled(self, observations: Observations) -> FloatArray:
        return shuffled_values(self.model, unrelated_draws(observations, self._salt))

    def horizons(self, world: World) -> FloatArray:
        """T_c of every world, (N,) [s]."""
        return self._held.horizons

    def shares(self, world: World) -> FloatArray:
        """Demanded part of S_safe in every world, (N,) in [0, 1]."""
        return self._held.shares

    def importance(self, world: World) -> FloatArray:
        """IR of every vehicle, then every pedestrian, (N, V + P); placed once per decision."""
        if self._by_object is None:
            self._by_object = np.empty((len(world), world.vehicles.shape[1] + world.pedestrians.shape[1]))
            place_importance(world.ego, world.vehicles, world.pedestrians, self._held.importance, self._by_object)
        return self._by_object


class RiskGuardedPolicy(NetworkPolicy):
    """A network policy that carries its risk model with it."""

    @classmethod
    def of(cls, policy: NetworkPolicy) -> RiskGuardedPolicy:
        """The same policy; its shield must be a `RiskGuard`."""
        return cls(policy.architecture, policy.network, policy.action_mode, policy.shield, policy.features)

    def save(self, folder: Path) -> None:
        """Write actor and risk model."""
        super().save(folder)
        assert isinstance(self.shield, RiskGuard)
        self.shield.model.save(folder)


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
        shield = self.shield()
        return train_sac(task, shield, features=features_of(shield, self.parameters["aware"]))

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The saved actor behind the same guard."""
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
        SACSettings.for_task(task)  # refused now rather than after the other two trainings
        model = risk_model(task.scenario, min(task.budget.steps, AGENT_STEPS_MAX), task.cache, making=task.making)
        shield = RiskGuard(model, self.parameters["tc"], self.parameters["rq"])
        shield.begin(task.stream("shield"))
        features = features_of(shield, self.parameters["aware"])
        return RiskGuardedPolicy.of(train_sac(task, shield, features=features))

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The saved actor behind the saved risk model."""
        shield = RiskGuard(RiskModel.load(folder, task.scenario.id), self.parameters["tc"], self.parameters["rq"])
        return RiskGuardedPolicy.load(folder, shield, features_of(shield, self.parameters["aware"]))

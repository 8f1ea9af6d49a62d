"""The guard steered by a risk model: its T_c, or the share of S_safe that it demands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy import special

from algorithms.guard_demand import Demand, require_horizon
from algorithms.guard_options import GuardOptions
from algorithms.method import Observations
from algorithms.networks import NetworkPolicy
from algorithms.risk_model import RiskModel, RiskOutput, adjustment_time, risk_percent
from algorithms.risk_training import shuffled_values, unrelated_draws
from algorithms.safety_guard import SafetyGuard
from envs.compiled import borrowed, njit
from envs.observation import EMPTY, rank_objects
from envs.scenario import PEDESTRIAN_SLOTS, VEHICLE_SLOTS
from envs.world import FloatArray, Records, World


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

    def _answer(self, observations: Observations, output: RiskOutput) -> tuple[Demand, FloatArray]:
        """T_c is fixed; the share of S_safe is the probability of contact, RQ."""
        share = special.expit(output.value)
        if self._share_source == "mean":
            share = np.full(len(share), float(self.model.description["value_mean"]))
        if self._share_source == "shuffled":
            share = self._shuffled(observations)
        return Demand(np.full(len(share), self.tc), share, output.importance), 100.0 * share


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

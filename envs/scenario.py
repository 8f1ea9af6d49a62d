"""Scenarios: what is simulated, as frozen, validated values with a version."""

from __future__ import annotations

import dataclasses
import difflib
import enum
from dataclasses import dataclass
from typing import Final

from envs.plugins import DuplicateNameError, UnavailableError, load, origins

ENTRY_POINT_GROUP: Final = "bench.scenarios"
STEP_S: Final = 0.1
"""Simulation step [s] (paper, appendix)."""
LANE_WIDTH_M: Final = 3.5
LANES: Final = 3
GOAL_M: Final = 760.0
"""Episode length s_max [m] (Table I)."""
TIME_LIMIT_S: Final = 90.0
SPAWN_STRETCH_M: Final = 180.0
"""Traffic is spawned within this distance ahead of the ego [m] (paper, Sec. V-A)."""
EGO_SPEED_MAX_MPS: Final = 13.89
"""v_max, 50 km/h [m/s]."""
VEHICLE_SLOTS: Final = 5
PEDESTRIAN_SLOTS: Final = 3
FIRST_SPAWN_M: Final = 20.0
"""Nearest spawn ahead of the ego, centre to centre [m]."""
SPACING_M: Final = 20.0
"""Least spacing of cars in one lane at the start, centre to centre [m]."""
LANE_CAPACITY: Final = int((SPAWN_STRETCH_M - FIRST_SPAWN_M) // SPACING_M) + 1
"""Cars that fit into one lane of the spawn stretch."""
VEHICLES_MAX: Final = LANES * LANE_CAPACITY


class UnknownNameError(ValueError):
    """A name that is not known, with the nearest known ones."""

    def __init__(self, kind: str, name: str, known: list[str]) -> None:
        near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
        hint = f" Did you mean {' or '.join(near)}?" if near else ""
        super().__init__(f"Unknown {kind} {name!r}.{hint} Known: {', '.join(sorted(known))}.")
        self.name = name
        self.suggestions = near


class PedestrianRule(enum.StrEnum):
    """When a waiting pedestrian steps off the kerb."""

    NONE = "none"
    """No pedestrians."""
    FAIR = "fair"
    """Only while the ego can still stop at -2 m/s2."""
    LATE = "late"
    """Without regard to the ego: some crashes are unavoidable."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """One constrained MDP: road, traffic, pedestrians, start, decision period.

    Source: paper, Sec. V-A; gaps settled in docs/fidelity.md.

    Attributes:
        name: Canonical name, parameters included, for example ``a:vehicles=8``.
        version: Raised by every change that alters results; results of two versions are never compared.
        vehicles: Number of traffic vehicles, 1 to 27: what fits into the spawn stretch.
        lane_changes: Whether traffic changes lanes by MOBIL.
        pedestrian_rule: When pedestrians step off the kerb, `PedestrianRule`.
        standing_start: Ego starts from rest instead of at U(8, 12) m/s.
        randomised_traffic: Number, speeds and IDM parameters of the traffic are drawn anew in each episode
            (the data set of Alg. 1).
        decision_period_s: The policy decides once per period and its action holds in between [s], a multiple of 0.1.
    """

    name: str
    version: int = 1
    vehicles: int = 5
    lane_changes: bool = False
    pedestrian_rule: PedestrianRule = PedestrianRule.NONE
    standing_start: bool = False
    randomised_traffic: bool = False
    decision_period_s: float = 0.5

    def __post_init__(self) -> None:
        """Refuse values that no world can be built from."""
        if not 1 <= self.vehicles <= VEHICLES_MAX:
            room = f"{SPAWN_STRETCH_M:.0f} m of {LANES} lanes at {SPACING_M:.0f} m spacing"
            raise ValueError(f"vehicles = {self.vehicles}: must be 1 to {VEHICLES_MAX}, what fits into {room}.")
        steps = self.decision_period_s / STEP_S
        if not (0.999 <= steps <= 100.001 and abs(steps - round(steps)) < 1e-6):
            raise ValueError(
                f"decision_period_s = {self.decision_period_s}: must be a multiple of {STEP_S} s, at most 10 s."
            )

    @property
    def substeps(self) -> int:
        """Simulation steps of 0.1 s per decision."""
        return round(self.decision_period_s / STEP_S)

    @property
    def pedestrians(self) -> int:
        """Number of pedestrians in an episode."""
        return 0 if self.pedestrian_rule is PedestrianRule.NONE else PEDESTRIAN_SLOTS

    @property
    def id(self) -> str:
        """Name and version, for example ``a-v1``: results carry it."""
        return f"{self.name}-v{self.version}"


_BUILT_IN: Final[dict[str, Scenario]] = {
    s.name: s
    for s in (
        Scenario("a"),
        Scenario("a-dense", vehicles=12),
        Scenario("a-mobil", lane_changes=True),
        Scenario("a-dense-mobil", vehicles=12, lane_changes=True),
        Scenario("a-standing", standing_start=True),
        Scenario("b", pedestrian_rule=PedestrianRule.FAIR),
        Scenario("b-late", pedestrian_rule=PedestrianRule.LATE),
        Scenario("b-standing", pedestrian_rule=PedestrianRule.FAIR, standing_start=True),
    )
}

GYMNASIUM_IDS: Final[dict[str, str]] = {
    "a": "bench/DenseTraffic-v1",
    "a-dense": "bench/DenseTrafficTwelve-v1",
    "a-mobil": "bench/DenseTrafficMobil-v1",
    "a-dense-mobil": "bench/DenseTrafficTwelveMobil-v1",
    "a-standing": "bench/DenseTrafficStanding-v1",
    "b": "bench/MixedTraffic-v1",
    "b-late": "bench/MixedTrafficLate-v1",
    "b-standing": "bench/MixedTrafficStanding-v1",
}
"""gymnasium id of each built-in scenario; its version is the scenario's."""

_PARAMETERS: Final = {f.name: f.type for f in dataclasses.fields(Scenario) if f.name not in ("name", "version")}


def _origins() -> dict[str, list[str]]:
    return origins(ENTRY_POINT_GROUP, dict.fromkeys(_BUILT_IN, "envs.scenario"))


def scenario_names() -> list[str]:
    """Names of all known scenarios, built-in ones first; one of a broken package is among them."""
    return list(_origins())


def _load(base: str) -> Scenario:
    known = _origins()
    if base not in known:
        raise UnknownNameError("scenario", base, list(known))
    if len(known[base]) > 1:
        raise DuplicateNameError("Scenario", base, known[base])
    if base in _BUILT_IN:
        return _BUILT_IN[base]
    (origin,) = known[base]
    loaded = load(origin)
    if not isinstance(loaded, Scenario) or loaded.name != base:
        raise UnavailableError(f"{origin} is {loaded!r}: must be a Scenario whose name is {base!r}.")
    return loaded


def _parse_value(key: str, text: str) -> bool | int | float | PedestrianRule:
    kind = str(_PARAMETERS[key])
    try:
        if kind == "bool":
            return {"true": True, "false": False}[text.lower()]
        if kind == "int":
            return int(text)
        return PedestrianRule(text) if kind == "PedestrianRule" else float(text)
    except (KeyError, ValueError):
        raise ValueError(f"Scenario parameter {key} = {text!r}: expected {kind}.") from None


def get_scenario(name: str) -> Scenario:
    """Scenario of a name, with parameters after a colon: ``a``, ``a:vehicles=8,decision_period_s=0.1``.

    Raises:
        UnknownNameError: The scenario or a parameter is unknown.
        UnavailableError: Its package is broken, or several packages claim the name.
        ValueError: A parameter's value is malformed or out of range.
    """
    base, _, tail = name.partition(":")
    scenario = _load(base)
    changes: dict[str, bool | int | float | PedestrianRule] = {}
    for item in filter(None, tail.split(",")):
        key, equals, text = item.partition("=")
        if key not in _PARAMETERS:
            raise UnknownNameError("scenario parameter", key, list(_PARAMETERS))
        if not equals:
            raise ValueError(f"Scenario parameter {item!r}: expected KEY=VALUE.")
        changes[key] = _parse_value(key, text)
    changes = {key: value for key, value in sorted(changes.items()) if getattr(scenario, key) != value}
    if not changes:
        return scenario
    canonical = ",".join(f"{k}={str(v).lower() if isinstance(v, bool) else v}" for k, v in changes.items())
    return dataclasses.replace(scenario, name=f"{base}:{canonical}", **changes)  # type: ignore[arg-type]

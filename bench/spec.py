"""`RunSpec`: one run as a frozen, validated value. Its hash names the folder of its record."""

from __future__ import annotations

import difflib
import hashlib
import json
import math
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

from pydantic import BaseModel, ConfigDict, field_serializer, field_validator, model_validator

from envs.scenario import Scenario, UnknownNameError, get_scenario
from envs.terms import CostSignal

SPEC_VERSION: Final = 1
"""Part of the hash; raised when the meaning of a field changes."""
COST_SIGNALS: Final = tuple(signal.name.lower() for signal in CostSignal)
SCENARIO_LENGTH: Final = 40
METHOD_LENGTH: Final = 60


class RunSpec(BaseModel):
    """Everything that decides a run's result.

    Attributes:
        method: Canonical name with parameters, for example ``safety-guard:tc=1.0``.
        method_version: Version of the method's results.
        scenario: Canonical name with parameters, for example ``a:decision_period_s=0.1``.
        scenario_version: Version of the scenario.
        seed: Replicate number.
        steps: Simulation steps of 0.1 s for training; 0 for a method that does not train.
        eval_episodes: Length of the held-out list.
        cost_limit: Bound on the undiscounted episode cost.
        cost_signal: What costs 1: ``collision``, ``proximity`` or ``ttc``.
        settings: Method settings, texts by key.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    method: str
    method_version: int
    scenario: str
    scenario_version: int
    seed: int
    steps: int
    eval_episodes: int
    cost_limit: float = 0.05
    cost_signal: str = "collision"
    settings: Mapping[str, str] = {}

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        if isinstance(data, Mapping):
            for key in data:
                if key not in cls.model_fields:
                    near = difflib.get_close_matches(str(key), cls.model_fields, n=1, cutoff=0.0)
                    raise ValueError(f"A run specification has no field {key!r}; the nearest is {near[0]!r}.")
        return data

    @field_validator("seed", "steps")
    @classmethod
    def _not_negative(cls, value: int) -> int:
        if value < 0:
            raise ValueError(f"{value}: must not be negative.")
        return value

    @field_validator("eval_episodes")
    @classmethod
    def _positive(cls, value: int) -> int:
        if value < 1:
            raise ValueError(f"{value}: must be at least 1.")
        return value

    @field_validator("cost_limit")
    @classmethod
    def _finite(cls, value: float) -> float:
        if not (math.isfinite(value) and value >= 0.0):
            raise ValueError(f"{value}: must be a finite number, at least 0.")
        return float(value)

    @field_validator("cost_signal")
    @classmethod
    def _known_signal(cls, value: str) -> str:
        if value not in COST_SIGNALS:
            raise UnknownNameError("cost signal", value, list(COST_SIGNALS))
        return value

    @field_validator("settings", mode="after")
    @classmethod
    def _freeze(cls, value: Mapping[str, str]) -> Mapping[str, str]:
        return MappingProxyType(dict(sorted(value.items())))

    @field_serializer("settings")
    def _thaw(self, value: Mapping[str, str]) -> dict[str, str]:
        return dict(value)

    @property
    def scenario_id(self) -> str:
        """Name and version, for example ``a-v1``."""
        return f"{self.scenario}-v{self.scenario_version}"

    @property
    def canonical_json(self) -> str:
        """One text for one meaning: sorted keys, no blanks, with the version of the specification itself."""
        content = {"spec_version": SPEC_VERSION, **self.model_dump()}
        return json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)

    @property
    def hash(self) -> str:
        """SHA-256 of `canonical_json`, hexadecimal."""
        return hashlib.sha256(self.canonical_json.encode()).hexdigest()

    @property
    def folder_name(self) -> str:
        """Readable and unique, for example ``a-v1_safety-guard-tc=1.0_s0_0123456789ab``."""
        scenario = _safe(f"{self.scenario}-v{self.scenario_version}")[:SCENARIO_LENGTH]
        return f"{scenario}_{_safe(self.method)[:METHOD_LENGTH]}_s{self.seed}_{self.hash[:12]}"

    @property
    def label(self) -> str:
        """For people: ``safety-guard:tc=1.0 on a-v1, seed 0``."""
        return f"{self.method} on {self.scenario_id}, seed {self.seed}"

    @property
    def variant(self) -> tuple[object, ...]:
        """What runs must share to be pooled over seeds: everything but the seed."""
        content = self.model_dump(exclude={"seed", "settings"})
        return (*content.values(), *self.settings.items())

    def resolve_scenario(self) -> Scenario:
        """The scenario as this version of the project defines it.

        Raises:
            ValueError: It is unknown, or of another version than the specification's.
        """
        scenario = get_scenario(self.scenario)
        if scenario.version != self.scenario_version:
            raise ValueError(
                f"{self.label}: this project has {scenario.id}; check out the version that the run is for."
            )
        return scenario


def _safe(text: str) -> str:
    """Only characters that every file system takes, and no hidden name."""
    return re.sub(r"[^A-Za-z0-9.=+-]|^\.", "-", text)

"""``--set KEY=VALUE``: what may be changed besides the protocol."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from bench.errors import UsageError
from bench.spec import COST_SIGNALS
from envs.scenario import UnknownNameError

COST_LIMIT: Final = "cost.limit"
COST_SIGNAL: Final = "cost.signal"
SCENARIO: Final = "scenario."
DEFAULT_LIMIT: Final = 0.05
DEFAULT_SIGNAL: Final = "collision"


@dataclass(frozen=True, slots=True)
class Settings:
    """Parsed settings.

    Attributes:
        cost_limit: ``cost.limit``, bound on the undiscounted episode cost.
        cost_signal: ``cost.signal``, one of `bench.spec.COST_SIGNALS`.
        scenario: ``scenario.KEY`` by key; put into the name of each scenario.
        methods: ``METHOD.KEY`` by method and key.
    """

    cost_limit: float = DEFAULT_LIMIT
    cost_signal: str = DEFAULT_SIGNAL
    scenario: Mapping[str, str] = field(default_factory=dict)
    methods: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    @classmethod
    def parse(cls, texts: Sequence[str], methods: Mapping[str, Sequence[str]]) -> Settings:
        """Settings of ``KEY=VALUE`` texts.

        Args:
            texts: As typed; a later one for the same key wins.
            methods: Keys that each selected method accepts, by its name.

        Raises:
            UsageError: A key is unknown, with the nearest known ones, or a value cannot be used.
        """
        known = [f"{name}.{key}" for name, keys in methods.items() for key in keys]
        limit, signal = DEFAULT_LIMIT, DEFAULT_SIGNAL
        scenario: dict[str, str] = {}
        of_methods: dict[str, dict[str, str]] = {}
        for text in texts:
            key, equals, value = (part.strip() for part in text.partition("="))
            if not equals or not value:
                raise UsageError(f"--set {text}: expected KEY=VALUE, for example {COST_LIMIT}=0.1.")
            if key == COST_LIMIT:
                limit = _limit(value)
            elif key == COST_SIGNAL:
                signal = _signal(value)
            elif key.startswith(SCENARIO):
                scenario[key.removeprefix(SCENARIO)] = value
            elif key in known:
                name, _, rest = key.partition(".")
                of_methods.setdefault(name, {})[rest] = value
            else:
                everything = [COST_LIMIT, COST_SIGNAL, f"{SCENARIO}decision_period_s", *known]
                raise UsageError(str(UnknownNameError("setting", key, everything)))
        return cls(limit, signal, scenario, of_methods)

    def amend_scenario(self, name: str) -> str:
        """A scenario's name with the ``scenario.KEY`` settings appended as parameters."""
        if not self.scenario:
            return name
        changes = ",".join(f"{key}={value}" for key, value in self.scenario.items())
        return f"{name},{changes}" if ":" in name else f"{name}:{changes}"


def _limit(text: str) -> float:
    try:
        limit = float(text)
    except ValueError:
        limit = math.nan
    if not (math.isfinite(limit) and limit >= 0.0):
        raise UsageError(f"--set {COST_LIMIT}={text}: must be a number of at least 0, such as 0.05.")
    return limit


def _signal(text: str) -> str:
    if text not in COST_SIGNALS:
        raise UsageError(str(UnknownNameError("cost signal", text, list(COST_SIGNALS))))
    return text

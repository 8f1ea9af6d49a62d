"""What ``bench list`` shows: methods and scenarios."""

from __future__ import annotations

import dataclasses
from typing import Any

from algorithms.registry import list_methods
from bench.text import columns, json_text
from envs.scenario import GYMNASIUM_IDS, Scenario, get_scenario, scenario_names


def _scenario(scenario: Scenario) -> dict[str, Any]:
    return {
        "name": scenario.name,
        "id": scenario.id,
        "gymnasium_id": GYMNASIUM_IDS.get(scenario.name),
        "version": scenario.version,
        "vehicles": scenario.vehicles,
        "lane_changes": scenario.lane_changes,
        "pedestrian_rule": str(scenario.pedestrian_rule),
        "standing_start": scenario.standing_start,
        "decision_period_s": scenario.decision_period_s,
    }


def as_json() -> str:
    """``{"methods": [...], "scenarios": [...]}``."""
    methods = [dataclasses.asdict(listing) for listing in list_methods()]
    return json_text({"methods": methods, "scenarios": [_scenario(get_scenario(name)) for name in scenario_names()]})


def as_text() -> str:
    """Two tables."""
    methods = [(item.name, "yes" if item.available else "no", item.reason or item.origin) for item in list_methods()]
    scenarios = []
    for name in scenario_names():
        s = get_scenario(name)
        traits = [f"{s.vehicles} vehicles" + (" that change lanes" if s.lane_changes else "")]
        traits += [f"pedestrians ({s.pedestrian_rule})"] if s.pedestrians else []
        traits += ["standing start"] if s.standing_start else []
        scenarios.append((s.name, s.id, GYMNASIUM_IDS.get(s.name, ""), ", ".join(traits)))
    return (
        columns(("method", "available", "from, or why not"), methods)
        + "\n\n"
        + columns(("scenario", "id", "gymnasium id", "traffic"), scenarios)
    )

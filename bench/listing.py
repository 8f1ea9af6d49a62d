"""What ``bench list`` shows: methods and scenarios."""

from __future__ import annotations

import dataclasses
from typing import Any

from algorithms.registry import list_methods
from bench.text import columns, json_text
from envs.plugins import UnavailableError
from envs.scenario import GYMNASIUM_IDS, get_scenario, scenario_names


def _scenario(name: str) -> dict[str, Any]:
    try:
        scenario = get_scenario(name)
    except UnavailableError as error:
        return {"name": name, "available": False, "reason": str(error)}
    return {
        "available": True,
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
    return json_text({"methods": methods, "scenarios": [_scenario(name) for name in scenario_names()]})


def as_text() -> str:
    """Two tables."""
    methods = [(item.name, "yes" if item.available else "no", item.reason or item.origin) for item in list_methods()]
    scenarios = []
    for name in scenario_names():
        try:
            s = get_scenario(name)
        except UnavailableError as error:
            scenarios.append((name, "", "", f"unavailable: {error}"))
            continue
        traits = [f"{s.vehicles} vehicles" + (" that change lanes" if s.lane_changes else "")]
        traits += [f"pedestrians ({s.pedestrian_rule})"] if s.pedestrians else []
        traits += ["standing start"] if s.standing_start else []
        scenarios.append((s.name, s.id, GYMNASIUM_IDS.get(s.name, ""), ", ".join(traits)))
    return (
        columns(("method", "available", "from, or why not"), methods)
        + "\n\n"
        + columns(("scenario", "id", "gymnasium id", "traffic"), scenarios)
    )

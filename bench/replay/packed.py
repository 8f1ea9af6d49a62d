"""A replay as compact JSON for the player in a browser, and as compressed text for a page that holds many."""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench.replay.draw import closest_step
from bench.replay.held_out import Replay
from bench.replay.shield_watch import GuardView
from envs.geometry import PEDESTRIAN_SIZE_M, ROAD_EDGE_M, VEHICLE_LENGTH_M, VEHICLE_WIDTH_M
from envs.motion import ACCELERATION_MAX_MPS2, ACCELERATION_MIN_MPS2
from envs.scenario import GOAL_M, LANE_WIDTH_M, STEP_S
from envs.trace import EpisodeTrace
from envs.world import Ending, Fault

CENTI: Final = 100.0
MILLI: Final = 1000.0
LIMIT_MPS2: Final = 9.99
"""Stands for a limit that is not there, or weaker than it."""
ROAD: Final = {
    "step_s": STEP_S,
    "edge_m": ROAD_EDGE_M,
    "lane_m": LANE_WIDTH_M,
    "goal_m": GOAL_M,
    "car_m": [VEHICLE_LENGTH_M, VEHICLE_WIDTH_M],
    "pedestrian_m": PEDESTRIAN_SIZE_M,
    "acceleration_mps2": [ACCELERATION_MIN_MPS2, ACCELERATION_MAX_MPS2],
}
"""What the player must know of the road; the same for every scenario."""


def packed(replay: Replay) -> dict[str, Any]:
    """Plain values: positions in cm, headings in mrad, speeds in cm/s, as differences of differences.

    Every series of states has T + 1 entries, of actions T.
    """
    trace = replay.trace
    present = trace.vehicles["present"][0] == 1
    people = np.arange(trace.pedestrians.shape[1])
    content: dict[str, Any] = {
        "title": replay.title,
        "scenario": trace.scenario.id,
        "episode": trace.number,
        "exact": replay.exact,
        "steps": len(trace),
        "ending": Ending(trace.episode["ending"][-1]).name.lower().replace("_", "-"),
        "fault": Fault(trace.episode["fault"][-1]).name.lower().replace("_", "-"),
        "closest": closest_step(replay) if math.isfinite(trace.episode["ttc_min"][-1]) else None,
        "figures": figures(trace),
        "ego": {name: _series(trace.ego[name], CENTI) for name in ("s", "d", "speed", "acceleration", "target_d")},
        "cars": [
            {"s": _series(car["s"], CENTI), "d": _series(car["d"], CENTI), "heading": _series(car["heading"], MILLI)}
            for car in trace.vehicles.T[present]
        ],
        "people": [
            {"s": _series(one["s"], CENTI), "d": _series(one["d"], CENTI), "state": _series(one["state"])}
            for one in trace.pedestrians.T
        ],
        "intervened": _series(trace.intervened),
        "asked_d": _series(trace.proposed[:, 0], CENTI),
    }
    content["ego"]["heading"] = _series(trace.ego["heading"], MILLI)
    if np.isfinite(trace.proposed[:, 1]).all():
        content["asked_a"] = _series(trace.proposed[:, 1], CENTI)
    if replay.guard is not None:
        shown = np.concatenate([np.flatnonzero(present), len(present) + people])
        content["guard"] = _guard(replay.guard, shown)
    return content


def figures(trace: EpisodeTrace) -> dict[str, Any]:
    """What a person wants to know of an episode; None where there is no number."""
    total = trace.episode[-1]
    seconds = STEP_S * max(len(trace), 1)
    ttc = float(total["ttc_min"])
    return {
        "distance_m": round(float(total["distance"]), 1),
        "time_s": round(STEP_S * len(trace), 1),
        "speed_mps": round(float(total["distance"]) / seconds, 2),
        "ttc_min_s": round(ttc, 2) if math.isfinite(ttc) else None,
        "acceleration_min_mps2": round(float(total["acceleration_min"]), 2),
        "interventions": int(total["interventions"]),
        "altered": int(total["altered"]),
        "lane_changes": int(total["lane_changes"]),
    }


def _guard(guard: GuardView, shown: npt.NDArray[np.int64]) -> dict[str, Any]:
    """Guard's series: T_c and limits in hundredths, RQ and importance in percent, of the bodies that are drawn."""
    content: dict[str, Any] = {
        "tc": _series(guard.tc_s, CENTI),
        "ahead": _series(np.clip(guard.limit_ahead_mps2, -LIMIT_MPS2, LIMIT_MPS2), CENTI),
    }
    if np.isfinite(guard.risk_percent).all():
        content["risk"] = _series(guard.risk_percent)
    if (guard.share != 1.0).any():
        content["share"] = _series(guard.share, CENTI)
    if guard.importance.any():
        content["importance"] = [_series(column, CENTI) for column in guard.importance.T[shown]]
    return content


def _series(values: npt.NDArray[Any], scale: float = 1.0) -> list[int]:
    """Rounded values as second differences: small numbers, which compress well."""
    whole = np.rint(np.asarray(values, np.float64) * scale).astype(np.int64)
    differences: list[int] = np.diff(whole, n=2, prepend=[0, 0]).tolist()
    return differences


def packed_text(replays: Sequence[Replay]) -> str:
    """Replays that are shown together, as base64 of deflated JSON; the same replays give the same text."""
    text = json.dumps([packed(replay) for replay in replays], separators=(",", ":"), allow_nan=False)
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode()

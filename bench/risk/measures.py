"""What a risk score is worth: rank correlations, ROC area, calibration; groups are episodes."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from algorithms.risk_training import CONTACT
from bench.risk.rollouts import METHODS, Rollouts
from bench.statistics import Estimate, Reliability, area_under_curve_interval, reliability, spearman_interval
from envs.world import FloatArray

THINNED: Final = 20_000
"""Scenes behind an interval: resampling 100,000 takes minutes and moves it little."""
RESAMPLES: Final = 300
SEED: Final = 0
QUANTILES: Final = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
BINS: Final = 10


def estimate_values(estimate: Estimate) -> dict[str, Any]:
    """An estimate as plain values."""
    return {
        "value": estimate.value,
        "low": estimate.interval.low,
        "high": estimate.interval.high,
        "episodes": estimate.replicates,
    }


def distribution(values: FloatArray) -> dict[str, Any]:
    """Mean, standard deviation and quantiles, shape (M,) in."""
    quantiles = zip(QUANTILES, np.quantile(values, QUANTILES).tolist(), strict=True)
    return {"mean": float(values.mean()), "sd": float(values.std()), "quantiles": {f"{q:g}": v for q, v in quantiles}}


def calibration(rollouts: Rollouts, method: str) -> Reliability:
    """RQ / 100 in bins against the rate of contact within 3 s.

    Only for dd-rq-plus is RQ / 100 a probability; that of dd-rq is a planning time on another scale, and its
    calibration error says how far off it would be if it were read as one.
    """
    return reliability(np.clip(0.01 * rollouts.risk(method), 0.0, 1.0), rollouts.contact.astype(float), BINS)


def judge(rollouts: Rollouts, method: str) -> dict[str, Any]:
    """Figures of one method's RQ."""
    step = -(-len(rollouts.episodes) // THINNED)
    risk, contact = rollouts.risk(method), rollouts.contact.astype(float)
    thin: dict[str, Any] = {"groups": rollouts.episodes[::step], "resamples": RESAMPLES}
    rng = np.random.default_rng(SEED)
    curve = calibration(rollouts, method)
    return {
        "risk_percent": distribution(risk),
        "spearman_inverse_ttc": estimate_values(
            spearman_interval(risk[::step], rollouts.inverse_ttc[::step], rng, **thin)
        ),
        "spearman_contact": estimate_values(spearman_interval(risk[::step], contact[::step], rng, **thin)),
        "auc_contact": estimate_values(area_under_curve_interval(risk[::step], contact[::step], rng, **thin)),
        "is_probability": method == METHODS[CONTACT],
        "expected_calibration_error": curve.expected_calibration_error,
        "mean_predicted": float(0.01 * risk.mean()),
        "bins": [
            {
                "low": row.low,
                "high": row.high,
                "scenes": row.samples,
                "contacts": row.events,
                "mean_predicted": row.mean_predicted,
                "observed": row.observed,
                "observed_low": row.interval.low,
                "observed_high": row.interval.high,
            }
            for row in curve.bins
        ],
    }

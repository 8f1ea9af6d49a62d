"""Rates, intervals, aggregates and paired tests: pure functions of arrays; seeds are the replicates.

Nothing here reads records or draws from a global generator. Which function answers which question:

- `seed_rate`: a collision rate of a *method*, for new seeds. `exact_rate`: of one policy, for new episodes.
- `mean_difference`, `mean_ratio`, `rate_difference`: two methods against each other, for new seeds.
- `iqm_interval`, `probability_of_improvement_interval`: returns and speeds.
- `mcnemar_exact` with `holm`: collisions of these policies on the common held-out list;
  `paired_mean_difference`: the same for new seeds.
- `spearman_interval`, `area_under_curve_interval`, `reliability`: what a risk score is worth.
"""

from bench.statistics.aggregates import Resample, iqm, iqm_interval, performance_profile
from bench.statistics.association import (
    area_under_curve,
    area_under_curve_interval,
    spearman,
    spearman_interval,
)
from bench.statistics.differences import mean_difference, mean_interval, mean_ratio, rate_difference
from bench.statistics.exposure import Exposure, collisions_per_1000_km
from bench.statistics.improvement import probability_of_improvement, probability_of_improvement_interval
from bench.statistics.intervals import Estimate, Interval
from bench.statistics.paired import (
    McNemar,
    PairedScores,
    bootstrap_scenario_difference,
    holm,
    mcnemar_exact,
    paired_mean_difference,
)
from bench.statistics.rates import Rate, episodes_for_zero_claim, exact_rate, format_rate, zero_event_bound
from bench.statistics.reliability import Reliability, ReliabilityBin, reliability
from bench.statistics.seeds import SeedInterval, SeedRate, percentile_seed_rate, seed_rate

__all__ = [
    "Estimate",
    "Exposure",
    "Interval",
    "McNemar",
    "PairedScores",
    "Rate",
    "Reliability",
    "ReliabilityBin",
    "Resample",
    "SeedInterval",
    "SeedRate",
    "area_under_curve",
    "area_under_curve_interval",
    "bootstrap_scenario_difference",
    "collisions_per_1000_km",
    "episodes_for_zero_claim",
    "exact_rate",
    "format_rate",
    "holm",
    "iqm",
    "iqm_interval",
    "mcnemar_exact",
    "mean_difference",
    "mean_interval",
    "mean_ratio",
    "paired_mean_difference",
    "percentile_seed_rate",
    "performance_profile",
    "probability_of_improvement",
    "probability_of_improvement_interval",
    "rate_difference",
    "reliability",
    "seed_rate",
    "spearman",
    "spearman_interval",
    "zero_event_bound",
]

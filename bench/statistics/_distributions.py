"""The scipy special functions in use, typed; the one place that touches untyped scipy."""

from __future__ import annotations

from scipy import special  # type: ignore[import-untyped, unused-ignore]


def beta_quantile(probability: float, first: float, second: float) -> float:
    """Quantile of Beta(first, second)."""
    return float(special.betaincinv(first, second, probability))


def gamma_quantile(probability: float, shape: float) -> float:
    """Quantile of Gamma(shape) with scale 1."""
    return float(special.gammaincinv(shape, probability))


def normal_quantile(probability: float) -> float:
    """Quantile of the standard normal distribution."""
    return float(special.ndtri(probability))


def t_quantile(probability: float, degrees: float) -> float:
    """Quantile of Student's t."""
    return float(special.stdtrit(degrees, probability))


def fair_coin_tail(heads: int, tosses: int) -> float:
    """P(X <= heads) for X ~ Binomial(tosses, 1/2), with heads < tosses."""
    return float(special.betainc(tosses - heads, heads + 1, 0.5))


def logit(probability: float) -> float:
    """Log-odds."""
    return float(special.logit(probability))


def expit(log_odds: float) -> float:
    """Inverse of `logit`."""
    return float(special.expit(log_odds))

"""What a guard asks for: T_c, the demanded share of S_safe and the importance of bodies, checked by name."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.world import FloatArray


def require_horizon(tc: float, where: str = "") -> float:
    """T_c as a number, or an error that names it, and where it was asked for.

    Raises:
        ValueError: T_c is not positive or not finite.
    """
    if not (math.isfinite(tc) and tc > 0.0):
        raise ValueError(f"T_c = {tc} s{where}: must be positive and finite.")
    return float(tc)


def require_share(share: float, where: str = "") -> float:
    """The demanded part of S_safe as a number, or an error that names it, and where it was asked for.

    Raises:
        ValueError: It is not within 0 and 1.
    """
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"share = {share}{where}: must be between 0 and 1.")
    return float(share)


def require_demand(tc: float, share: float, importance: FloatArray, where: str) -> None:
    """Name what cannot be used of a world's T_c [s], share and importance, shape (V + P,).

    Raises:
        ValueError: T_c is not positive or not finite, the share is not within 0 and 1, an importance is not finite.
    """
    require_horizon(tc, where)
    require_share(share, where)
    for j in np.flatnonzero(~np.isfinite(importance)):
        raise ValueError(f"importance = {importance[j]} of body {j}{where}: must be finite.")


class Demand(NamedTuple):
    """What a guard will ask for at given observations.

    Attributes:
        horizons: T_c, shape (N,) [s].
        shares: Demanded part of S_safe, shape (N,), in [0, 1].
        importance: IR of each observation slot, shape (N, 8), in [0, 1].
    """

    horizons: FloatArray
    shares: FloatArray
    importance: FloatArray

"""What a shield answers is checked before the engine takes it: kernels neither check lengths nor clip NaN."""

from __future__ import annotations

from typing import Any

import numpy as np

from envs import batch
from envs.world import BoolArray, Ending, FloatArray, World

_BOOL = np.dtype(np.bool_)


def check_answer(
    shield: object, world: World, targets: FloatArray, accelerations: FloatArray, flags: BoolArray,
    horizons: FloatArray,
) -> None:  # fmt: skip
    """Refuse an answer that is not one usable value for each running world.

    Args:
        shield: Who answered; its class is named.
        world: The N worlds that it answered for; where an episode has ended, any value will do.
        targets: Lateral targets, shape (N,) [m].
        accelerations: Shape (N,) [m/s2].
        flags: Whether it intervened, bool, shape (N,).
        horizons: Of the lateral planner, > 0, shape (N,) [s].

    Raises:
        ValueError: A wrong shape or type; or in a running world a value that is not finite, or a horizon of 0 or less.
    """
    shape = (len(world),)
    if not _fits(shape, targets, accelerations, flags, horizons):
        answers = {"targets": targets, "accelerations": accelerations, "flags": flags, "horizons": horizons}
        kinds = ", ".join(f"{name} {_kind(given)}" for name, given in answers.items())
        raise ValueError(
            f"Shield {type(shield).__name__} gave {kinds}: must be arrays of shape {shape}, one value for each world, "
            "the flags of bool."
        )
    if batch.usable(targets, accelerations, horizons):
        return
    running = world.episode["ending"] == Ending.RUNNING
    for what, values in (("target", targets), ("acceleration", accelerations), ("horizon", horizons)):
        good = np.isfinite(values) & ((values > 0.0) if what == "horizon" else True)
        for i in np.flatnonzero(~good & running):
            must = "finite and above 0 s" if what == "horizon" else "finite"
            raise ValueError(f"Shield {type(shield).__name__} gave world {i} the {what} {values[i]}: must be {must}.")


def _fits(shape: tuple[int, ...], targets: Any, accelerations: Any, flags: Any, horizons: Any) -> bool:
    try:
        same = shape == targets.shape == accelerations.shape == flags.shape == horizons.shape
        return bool(same and flags.dtype == _BOOL)
    except AttributeError:  # no array
        return False


def _kind(given: Any) -> str:
    return f"{given.dtype} {given.shape}" if isinstance(given, np.ndarray) else repr(given)

"""What an environment and its users say to each other: what an action means, what costs, what is refused.

No kernels here: a command that only plans runs needs no compiler.
"""

from __future__ import annotations

import enum


class ActionMode(enum.Enum):
    """What a policy's action is."""

    ACCELERATION = "acceleration"
    """[d_fn, a_x]: lateral offset from the nearest lane's centre [m], acceleration [m/s2]."""
    PLANNING = "planning"
    """[T_c, d_fn, s_dot_f]: planning time [s], lateral offset [m], target speed [m/s]: the driving agent's."""


class CostSignal(enum.IntEnum):
    """What costs 1 in a step."""

    COLLISION = 0
    """A collision: the undiscounted episode cost is the collision rate."""
    PROXIMITY = 1
    """The bumper gap ahead is below S_safe, or a collision."""
    TTC = 2
    """Time to collision is below 1.5 s, or a collision."""


class BudgetExceededError(RuntimeError):
    """More decisions were asked for than the environment was made for."""


class MutatedObservationError(RuntimeError):
    """Who got the observations wrote into them."""

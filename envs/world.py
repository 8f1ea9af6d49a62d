"""The state of N worlds as arrays of records, each field with its unit."""

from __future__ import annotations

import enum
import os
from dataclasses import dataclass
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Records = npt.NDArray[Any]

# Frame: s along the road [m], d to the left of the middle lane's centre line [m]; lane i has its centre at
# (i - 1) * 3.5 m. A record per body keeps a world's state in a few cache lines, and a kernel's call cheap.

JIT_DISABLED: Final = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
"""Whether kernels run as plain Python, for coverage and debugging; known without numba, which takes 0.3 s to import."""
# Compiled code reads fields as attributes; uncompiled (coverage, debugging) only numpy's record class can.
_RECORD: Final = np.record if JIT_DISABLED else np.void


def _record(fields: list[tuple[str, str]]) -> np.dtype[Any]:
    return np.dtype((_RECORD, fields))


EGO: Final = _record(
    [
        ("s", "f8"),  # centre, along the road [m]
        ("d", "f8"),  # centre, across the road [m]
        ("speed", "f8"),  # [m/s], 0 to 13.89
        ("heading", "f8"),  # [rad]
        ("lateral_speed", "f8"),  # rate of d over the last step [m/s]
        ("acceleration", "f8"),  # executed over the last step [m/s2]
        ("reference_d", "f8"),  # planned lateral position now [m]
        ("reference_speed", "f8"),  # its rate [m/s]
        ("reference_acceleration", "f8"),  # its second derivative [m/s2]
        ("error_integral", "f8"),  # of the lateral tracking error [m s]
        ("error_previous", "f8"),  # lateral tracking error of the step before [m]
        ("target_d", "f8"),  # executed lateral target of the step before [m]
        ("command", "f8"),  # executed acceleration command of the step before [m/s2]
    ]
)

VEHICLE: Final = _record(
    [
        ("present", "i8"),  # 1 or 0
        ("s", "f8"),
        ("d", "f8"),
        ("speed", "f8"),
        ("heading", "f8"),
        ("desired_speed", "f8"),  # IDM v0 [m/s]
        ("headway", "f8"),  # IDM time gap [s]
        ("exponent", "f8"),  # IDM delta
        ("target_lane", "i8"),  # 0, 1, 2
        ("timer", "f8"),  # since the last MOBIL decision [s]
        ("acceleration", "f8"),  # decided for this step; after it executed, weaker where the car stopped [m/s2]
        ("steering", "f8"),  # decided for this step [rad]
    ]
)

WAITING: Final = 0
CROSSING: Final = 1
GONE: Final = 2

PEDESTRIAN: Final = _record(
    [
        ("state", "i8"),  # WAITING, CROSSING, GONE
        ("s", "f8"),
        ("d", "f8"),
        ("lateral_speed", "f8"),  # signed walking speed [m/s]
        ("trigger_gap", "f8"),  # wants to cross once the ego's bumper gap is below this [m]
    ]
)


class Ending(enum.IntEnum):
    """How an episode ended; the four endings sum to 100 % in every table."""

    RUNNING = 0
    GOAL = 1
    COLLISION = 2
    OFF_ROAD = 3
    TIME_OUT = 4


class Fault(enum.IntEnum):
    """What the ego collided with, judged from the step before contact."""

    NONE = 0
    AHEAD = 1
    SIDE = 2
    REAR_ENDED = 3
    PEDESTRIAN = 4


EPISODE: Final = _record(
    [
        ("episode", "i8"),  # number in its stream of scenarios; replays the episode
        ("steps", "i8"),  # simulation steps of 0.1 s
        ("ending", "i8"),  # Ending
        ("fault", "i8"),  # Fault
        ("ego_at_fault", "i8"),  # 1 or 0
        ("distance", "f8"),  # [m]
        ("return_driving", "f8"),  # sum of r_s + r_c + r_ld over 0.1 s steps
        ("return_comfort", "f8"),  # sum of r_cf
        ("return_risk", "f8"),  # sum of r_risk
        ("cost", "f8"),  # undiscounted, of the task's cost signal
        ("interventions", "i8"),  # steps flagged by the shield
        ("altered", "i8"),  # steps in which the shield changed the action
        ("altered_acceleration", "f8"),  # sum of |change| [m/s2]
        ("altered_target", "f8"),  # sum of |change| [m]
        ("ttc_min", "f8"),  # to a body ahead in the ego's path [s]; inf if it never closed in
        ("steps_inside_safe_gap", "i8"),  # bumper gap ahead below S_safe = 3.6 v
        ("steps_low_ttc", "i8"),  # time to collision below 1.5 s
        ("acceleration_min", "f8"),  # strongest braking [m/s2]
        ("steps_hard_braking", "i8"),  # acceleration at or below -1.8 m/s2
        ("jerk_sum", "f8"),  # sum of |change of acceleration| / 0.1 s [m/s3]
        ("lane_changes", "i8"),  # times the nearest lane changed
        ("tracking_error_max", "f8"),  # |planned - actual lateral position| [m]
        ("world", "i8"),  # that it ran in; set when it ends
        ("end_step", "i8"),  # simulation steps of all worlds together when it ended; set when it ends
    ]
)


@dataclass(frozen=True, slots=True)
class World:
    """N worlds.

    Attributes:
        ego: `EGO` records, shape (N,).
        vehicles: `VEHICLE` records, shape (N, V).
        pedestrians: `PEDESTRIAN` records, shape (N, P); P may be 0.
        episode: `EPISODE` records, shape (N,).
    """

    ego: Records
    vehicles: Records
    pedestrians: Records
    episode: Records

    def __len__(self) -> int:
        """Number of worlds."""
        return len(self.ego)

    def copy(self) -> World:
        """An independent copy."""
        return World(self.ego.copy(), self.vehicles.copy(), self.pedestrians.copy(), self.episode.copy())


def empty_world(worlds: int, vehicles: int, pedestrians: int) -> World:
    """Zeroed arrays for N worlds."""
    return World(
        np.zeros(worlds, EGO),
        np.zeros((worlds, vehicles), VEHICLE),
        np.zeros((worlds, pedestrians), PEDESTRIAN),
        np.zeros(worlds, EPISODE),
    )


def no_episodes() -> Records:
    """An empty array of `EPISODE` records."""
    return np.empty(0, EPISODE)


class Shield(Protocol):
    """Stands between policy and world at every 0.1 s step, in training and in application alike.

    A shield that remembers anything from one decision to the next, a generator for example, is `Resumable`, too:
    a run that was killed goes on with what it remembered.
    """

    def begin(self, seed: np.random.SeedSequence) -> None:
        """Called before a roll-out; a shield that draws numbers seeds itself here."""

    def observe(self, observations: npt.NDArray[np.float32]) -> None:
        """Called once per decision with the policy's observations, shape (N, 47), before `filter`."""

    def filter(
        self, world: World, targets: FloatArray, accelerations: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray | None]:
        """Replace unsafe actions. Must not change its arguments.

        Args:
            world: The worlds as they are now, N of them. Read only.
            targets: Lateral target of each ego in the road's frame, shape (N,) [m].
            accelerations: Proposed acceleration, shape (N,) [m/s2].

        Returns:
            Executed targets (N,) [m], executed accelerations (N,) [m/s2], whether the shield intervened (N,),
            and the lateral planner's horizon (N,) [s], > 0, or None for the default of 3 s.
        """
        ...


@runtime_checkable
class Resumable(Protocol):
    """Has a state of its own that a checkpoint must hold."""

    def snapshot(self) -> dict[str, Any]:
        """The state as JSON values."""
        ...

    def restore(self, values: dict[str, Any]) -> None:
        """Go on from a `snapshot`."""
        ...

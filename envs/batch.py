"""What surrounds the engine's steps in a decision, compiled: actions in, rewards and endings out, next episodes."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from envs.compiled import borrowed, njit, njit_parallel
from envs.geometry import lane_centre, nearest_lane
from envs.motion import HORIZON_S, TARGET_MAX_M
from envs.observation import write_observation
from envs.scenario import PEDESTRIAN_SLOTS, VEHICLE_SLOTS
from envs.world import BoolArray, Ending, FloatArray, Records

RUNNING, COLLISION, OFF_ROAD = int(Ending.RUNNING), int(Ending.COLLISION), int(Ending.OFF_ROAD)
VALID = -1


@njit
def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


@njit
def interpret_actions(
    ego: Records, actions: FloatArray, low: FloatArray, high: FloatArray, planning: bool,
    targets: FloatArray, commands: FloatArray, horizons: FloatArray, speeds: FloatArray,
) -> int:  # fmt: skip
    """Clip actions to their bounds and turn them into lateral targets, accelerations, horizons and speeds.

    Args:
        ego: `EGO` records, shape (N,).
        actions: Shape (N, A).
        low: Lower bounds, shape (A,).
        high: Upper bounds, shape (A,).
        planning: Whether actions are [T_c, d_fn, s_dot_f] instead of [d_fn, a_x].
        targets: Written: lateral targets in the road's frame, kept on the road, shape (N,) [m].
        commands: Written: accelerations, shape (N,) [m/s2].
        horizons: Written: planning horizons, shape (N,) [s].
        speeds: Written: target speeds, shape (N,) [m/s].

    Returns:
        -1, or the flat index of the first entry that is not finite; then nothing is to be used.
    """
    count = len(low)
    for i in range(actions.shape[0]):
        for k in range(count):
            if not math.isfinite(actions[i, k]):
                return i * count + k
        at = 1 if planning else 0
        offset = _clip(actions[i, at], low[at], high[at])
        centre = lane_centre(nearest_lane(ego[i].d))
        targets[i] = _clip(centre + offset, -TARGET_MAX_M, TARGET_MAX_M)
        if planning:
            horizons[i] = _clip(actions[i, 0], low[0], high[0])
            speeds[i] = _clip(actions[i, 2], low[2], high[2])
            commands[i] = 0.0
        else:
            horizons[i] = HORIZON_S
            speeds[i] = 0.0
            commands[i] = _clip(actions[i, 1], low[1], high[1])
    return VALID


@njit
def usable(targets: FloatArray, commands: FloatArray, horizons: FloatArray) -> bool:
    """Whether every target, acceleration and horizon, each (N,), is a finite number, and horizons are positive."""
    good = True
    for i in range(len(targets)):
        good &= math.isfinite(targets[i]) and math.isfinite(commands[i]) and 0.0 < horizons[i] < math.inf
    return good


@njit
def conclude(
    episode: Records, active: BoolArray, before: npt.NDArray[np.int64], sums: FloatArray, substeps: int, comfort: bool,
    rewards: FloatArray, without_risk: FloatArray, costs: FloatArray, intervened: npt.NDArray[np.int64],
    terminated: BoolArray, truncated: BoolArray,
) -> int:  # fmt: skip
    """Rewards, costs and endings of a decision; the last six arrays are written.

    Args:
        episode: `EPISODE` records, shape (N,).
        active: Worlds that took part, shape (N,).
        before: Their interventions before the decision, shape (N,).
        sums: Driving, comfort and risk reward and cost over the decision, shape (N, 4).
        substeps: Steps of a decision: the divisor of the rewards.
        comfort: Whether the reward includes r_cf.
        rewards: Shape (N,).
        without_risk: Rewards without r_risk, shape (N,).
        costs: Shape (N,).
        intervened: Steps that a shield flagged, shape (N,).
        terminated: Collision or off-road, shape (N,).
        truncated: Goal or time limit, shape (N,).

    Returns:
        Number of worlds whose episode ended.
    """
    ended = 0
    for i in range(episode.shape[0]):
        base = sums[i, 0] + (sums[i, 1] if comfort else 0.0)
        without_risk[i] = base / substeps
        rewards[i] = (base + sums[i, 2]) / substeps
        costs[i] = sums[i, 3]
        intervened[i] = episode[i].interventions - before[i]
        ending = episode[i].ending
        done = active[i] and ending != RUNNING
        terminated[i] = done and ending in (COLLISION, OFF_ROAD)
        truncated[i] = done and not terminated[i]
        before[i] = episode[i].interventions
        ended += done
    return ended


@njit
def load_episodes(
    ego: Records, vehicles: Records, pedestrians: Records, episode: Records, active: BoolArray,
    before: npt.NDArray[np.int64], worlds: npt.NDArray[np.int64],
    from_ego: Records, from_vehicles: Records, from_pedestrians: Records, from_episode: Records, row: int,
) -> None:  # fmt: skip
    """Begin episodes in the named worlds, in order, from consecutive rows of initial states."""
    for k in range(len(worlds)):
        i, at = worlds[k], row + k
        ego[i] = from_ego[at]
        episode[i] = from_episode[at]
        for j in range(vehicles.shape[1]):
            vehicles[i, j] = from_vehicles[at, j]
        for j in range(pedestrians.shape[1]):
            pedestrians[i, j] = from_pedestrians[at, j]
        active[i] = True
        before[i] = 0


@njit
def observe(
    ego: Records, vehicles: Records, pedestrians: Records, active: BoolArray, worlds: npt.NDArray[np.int64],
    out: npt.NDArray[np.float32],
) -> None:  # fmt: skip
    """Write the state vectors of the named worlds into their rows of out (N, 47); zeros where inactive."""
    ego, vehicles, pedestrians = borrowed(ego), borrowed(vehicles), borrowed(pedestrians)
    active, out = borrowed(active), borrowed(out)
    slots = np.empty(VEHICLE_SLOTS + PEDESTRIAN_SLOTS, np.int64)
    keys = np.empty(VEHICLE_SLOTS + PEDESTRIAN_SLOTS, np.float64)
    for i in worlds:
        _observe_world(ego, vehicles, pedestrians, active, i, out, slots, keys)


@njit_parallel
def observe_parallel(
    ego: Records, vehicles: Records, pedestrians: Records, active: BoolArray, worlds: npt.NDArray[np.int64],
    out: npt.NDArray[np.float32],
) -> None:  # fmt: skip
    """`observe` with the worlds shared among numba's threads."""
    slots = np.empty((len(worlds), VEHICLE_SLOTS + PEDESTRIAN_SLOTS), np.int64)
    keys = np.empty((len(worlds), VEHICLE_SLOTS + PEDESTRIAN_SLOTS), np.float64)
    for k in numba.prange(len(worlds)):
        _observe_world(ego, vehicles, pedestrians, active, worlds[k], out, slots[k], keys[k])


@njit
def _observe_world(
    ego: Records, vehicles: Records, pedestrians: Records, active: BoolArray, i: int,
    out: npt.NDArray[np.float32], slots: npt.NDArray[np.int64], keys: FloatArray,
) -> None:  # fmt: skip
    if active[i]:
        write_observation(ego, vehicles, pedestrians, i, out[i], slots, keys)
    else:
        out[i, :] = 0.0

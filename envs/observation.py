"""The state vector of Table I, one layout for all methods and scenarios.

| entries | content | scale |
|---|---|---|
| 0 | s of the ego | s / 760 m |
| 1 | d of the ego | d / 3.5 m |
| 2 | speed of the ego | v / 13.89 m/s |
| 3 | lateral speed of the ego | m/s |
| 4 | heading of the ego | rad |
| 5 + 5 i + (0..4) | i-th nearest vehicle, i = 0..4: ds, dd, dv_s, dv_d, heading | 200 m, 10.5 m, 11.11 m/s, m/s, rad |
| 30 + 3 j + (0..2) | j-th nearest crossing pedestrian, j = 0..2: ds, dd, v_d | 200 m, 10.5 m, m/s |
| 39..43 | 1 where the vehicle slot is filled | |
| 44..46 | 1 where the pedestrian slot is filled | |

Nearest by abs(ds). Bodies farther than 200 m away are not seen. Empty slots are 0 and their mask is 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from envs.compiled import njit
from envs.scenario import (
    EGO_SPEED_MAX_MPS,
    GOAL_M,
    LANE_WIDTH_M,
    LANES,
    PEDESTRIAN_SLOTS,
    VEHICLE_SLOTS,
)
from envs.world import CROSSING, BoolArray, FloatArray, Records

LAYOUT_VERSION: Final = 1
EGO_FEATURES: Final = 5
VEHICLE_FEATURES: Final = 5
PEDESTRIAN_FEATURES: Final = 3
VEHICLES_AT: Final = EGO_FEATURES
PEDESTRIANS_AT: Final = VEHICLES_AT + VEHICLE_SLOTS * VEHICLE_FEATURES
VEHICLE_MASK_AT: Final = PEDESTRIANS_AT + PEDESTRIAN_SLOTS * PEDESTRIAN_FEATURES
PEDESTRIAN_MASK_AT: Final = VEHICLE_MASK_AT + VEHICLE_SLOTS
OBSERVATION_SIZE: Final = PEDESTRIAN_MASK_AT + PEDESTRIAN_SLOTS

RANGE_M: Final = 200.0
LATERAL_SCALE_M: Final = LANES * LANE_WIDTH_M
SPEED_SCALE_MPS: Final = 11.11

EMPTY: Final = -1


def observation_bounds() -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Lowest and highest values of each entry, both of shape (47,).

    Lateral speeds are bounded by the traffic's largest speed, headings by a half turn. The ego's s and d leave
    room for the step in which it passes the goal, or the road's edge.
    """
    ego = [1.01, 1.7, 1.0, EGO_SPEED_MAX_MPS, math.pi]
    vehicle = [1.0, 1.0, EGO_SPEED_MAX_MPS / SPEED_SCALE_MPS, 2.0 * EGO_SPEED_MAX_MPS, math.pi]
    pedestrian = [1.0, 1.2, 2.0]
    signed = np.array([*ego, *vehicle * VEHICLE_SLOTS, *pedestrian * PEDESTRIAN_SLOTS])
    masks = np.ones(VEHICLE_SLOTS + PEDESTRIAN_SLOTS)
    low = np.concatenate([-signed, 0.0 * masks])
    low[0] = low[2] = 0.0
    return low.astype(np.float32), np.concatenate([signed, masks]).astype(np.float32)


def observation_space() -> spaces.Box:
    """Bounds of the state vector."""
    low, high = observation_bounds()
    return spaces.Box(low, high, dtype=np.float32)


@njit
def _insert_nearest(slots: npt.NDArray[np.int64], keys: npt.NDArray[np.float64], key: float, item: int) -> None:
    """Insert an item into slots kept in ascending order of key; the farthest falls out."""
    if key >= keys[-1]:
        return
    place = len(slots) - 1
    while place > 0 and key < keys[place - 1]:
        keys[place] = keys[place - 1]
        slots[place] = slots[place - 1]
        place -= 1
    keys[place] = key
    slots[place] = item


@njit
def rank_objects(
    ego: Records, vehicles: Records, pedestrians: Records, i: int,
    slots: npt.NDArray[np.int64], keys: npt.NDArray[np.float64],
) -> None:  # fmt: skip
    """Fill the slots with the nearest vehicles (first 5) and crossing pedestrians (last 3) of world i.

    Args:
        ego: `EGO` records, shape (N,).
        vehicles: `VEHICLE` records, shape (N, V).
        pedestrians: `PEDESTRIAN` records, shape (N, P).
        i: World.
        slots: Written, shape (8,): column of the body, or -1 where the slot is empty.
        keys: Scratch, shape (8,).
    """
    slots[:] = EMPTY
    keys[:] = np.nextafter(RANGE_M, math.inf)
    for j in range(vehicles.shape[1]):
        if vehicles[i, j].present == 1:
            _insert_nearest(slots[:VEHICLE_SLOTS], keys[:VEHICLE_SLOTS], abs(vehicles[i, j].s - ego[i].s), j)
    for j in range(pedestrians.shape[1]):
        if pedestrians[i, j].state == CROSSING:
            distance = abs(pedestrians[i, j].s - ego[i].s)
            _insert_nearest(slots[VEHICLE_SLOTS:], keys[VEHICLE_SLOTS:], distance, j)


@njit
def write_observation(
    ego: Records, vehicles: Records, pedestrians: Records, i: int, row: npt.NDArray[np.float32],
    slots: npt.NDArray[np.int64], keys: npt.NDArray[np.float64],
) -> None:  # fmt: skip
    """Write the state vector of world i into a row of 47 values."""
    rank_objects(ego, vehicles, pedestrians, i, slots, keys)
    e = ego[i]
    row[:] = 0.0
    row[0] = e.s / GOAL_M
    row[1] = e.d / LANE_WIDTH_M
    row[2] = e.speed / EGO_SPEED_MAX_MPS
    row[3] = e.lateral_speed
    row[4] = e.heading
    speed_s = e.speed * math.cos(e.heading)
    for slot in range(VEHICLE_SLOTS):
        j = slots[slot]
        if j == EMPTY:
            break
        v = vehicles[i, j]
        at = VEHICLES_AT + VEHICLE_FEATURES * slot
        row[at] = (v.s - e.s) / RANGE_M
        row[at + 1] = (v.d - e.d) / LATERAL_SCALE_M
        row[at + 2] = (v.speed * math.cos(v.heading) - speed_s) / SPEED_SCALE_MPS
        row[at + 3] = v.speed * math.sin(v.heading) - e.lateral_speed
        row[at + 4] = v.heading
        row[VEHICLE_MASK_AT + slot] = 1.0
    for slot in range(PEDESTRIAN_SLOTS):
        j = slots[VEHICLE_SLOTS + slot]
        if j == EMPTY:
            break
        p = pedestrians[i, j]
        at = PEDESTRIANS_AT + PEDESTRIAN_FEATURES * slot
        row[at] = (p.s - e.s) / RANGE_M
        row[at + 1] = (p.d - e.d) / LATERAL_SCALE_M
        row[at + 2] = p.lateral_speed
        row[PEDESTRIAN_MASK_AT + slot] = 1.0


@dataclass(frozen=True, slots=True)
class DecodedObservation:
    """State vectors back in SI units; empty slots hold 0 and are False in the masks.

    Attributes:
        s: Ego position, shape (N,) [m].
        d: Ego lateral position, shape (N,) [m].
        speed: Ego speed, shape (N,) [m/s].
        lateral_speed: Ego lateral speed, shape (N,) [m/s].
        heading: Ego heading, shape (N,) [rad].
        vehicle_ds: Vehicle minus ego along the road, shape (N, 5) [m].
        vehicle_dd: Vehicle minus ego across the road, shape (N, 5) [m].
        vehicle_dv: Vehicle minus ego speed along the road, shape (N, 5) [m/s].
        vehicle_heading: Shape (N, 5) [rad].
        vehicle_present: Shape (N, 5).
        pedestrian_ds: Pedestrian minus ego along the road, shape (N, 3) [m].
        pedestrian_dd: Pedestrian minus ego across the road, shape (N, 3) [m].
        pedestrian_speed: Signed walking speed, shape (N, 3) [m/s].
        pedestrian_present: Shape (N, 3).
    """

    s: FloatArray
    d: FloatArray
    speed: FloatArray
    lateral_speed: FloatArray
    heading: FloatArray
    vehicle_ds: FloatArray
    vehicle_dd: FloatArray
    vehicle_dv: FloatArray
    vehicle_heading: FloatArray
    vehicle_present: BoolArray
    pedestrian_ds: FloatArray
    pedestrian_dd: FloatArray
    pedestrian_speed: FloatArray
    pedestrian_present: BoolArray


def decode(observations: npt.NDArray[np.float32]) -> DecodedObservation:
    """State vectors (N, 47) in SI units."""
    x = observations.astype(np.float64)
    n = len(x)
    vehicles = x[:, VEHICLES_AT:PEDESTRIANS_AT].reshape(n, VEHICLE_SLOTS, VEHICLE_FEATURES)
    people = x[:, PEDESTRIANS_AT:VEHICLE_MASK_AT].reshape(n, PEDESTRIAN_SLOTS, PEDESTRIAN_FEATURES)
    return DecodedObservation(
        s=x[:, 0] * GOAL_M,
        d=x[:, 1] * LANE_WIDTH_M,
        speed=x[:, 2] * EGO_SPEED_MAX_MPS,
        lateral_speed=x[:, 3],
        heading=x[:, 4],
        vehicle_ds=vehicles[:, :, 0] * RANGE_M,
        vehicle_dd=vehicles[:, :, 1] * LATERAL_SCALE_M,
        vehicle_dv=vehicles[:, :, 2] * SPEED_SCALE_MPS,
        vehicle_heading=vehicles[:, :, 4],
        vehicle_present=x[:, VEHICLE_MASK_AT:PEDESTRIAN_MASK_AT] > 0.5,
        pedestrian_ds=people[:, :, 0] * RANGE_M,
        pedestrian_dd=people[:, :, 1] * LATERAL_SCALE_M,
        pedestrian_speed=people[:, :, 2],
        pedestrian_present=x[:, PEDESTRIAN_MASK_AT:] > 0.5,
    )

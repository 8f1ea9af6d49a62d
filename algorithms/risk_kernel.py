"""The risk network for driving: the same function as `algorithms.risk_model.RiskNetwork`, compiled, world by world.

Three things save work and change nothing beyond rounding: absent objects get no token, the last block works out only
what the ego's token needs, and the scale and shift of a layer norm are part of the linear map behind it. As every
world is worked out alone, its RQ does not depend on how many are driven beside it: an episode replays bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from envs.compiled import njit
from envs.observation import (
    EGO_FEATURES,
    PEDESTRIAN_FEATURES,
    PEDESTRIANS_AT,
    VEHICLE_FEATURES,
    VEHICLE_MASK_AT,
    VEHICLES_AT,
)
from envs.scenario import PEDESTRIAN_SLOTS, VEHICLE_SLOTS
from envs.world import FloatArray

Single = npt.NDArray[np.float32]

TOKENS: Final = 1 + VEHICLE_SLOTS + PEDESTRIAN_SLOTS
NORM_EPSILON: Final = np.float32(1e-5)
"""That of torch's LayerNorm."""
HALF, ONE, TWO, ROOT_HALF = np.float32(0.5), np.float32(1.0), np.float32(2.0), np.float32(math.sqrt(0.5))
ERF_EDGE: Final = np.float32(4.0)
"""Beyond it erf is 1 in single precision."""
ERF_SCALE: Final = np.float32(4.0 / 16.0)
"""2 (x / 4)^2 - 1 runs over [-1, 1]; this gives twice that."""
ERF_TERMS: Final = 15


def erf_series() -> Single:
    """Chebyshev coefficients of erf(x) / x in 2 (x / 4)^2 - 1 for |x| <= 4; error of erf below 3e-7."""
    nodes = np.cos(np.pi * (np.arange(256) + 0.5) / 256)
    x = float(ERF_EDGE) * np.sqrt(0.5 * (nodes + 1.0))
    values = np.array([math.erf(value) / value for value in x])
    orders = np.arange(ERF_TERMS)
    series = 2.0 / 256 * (np.cos(np.outer(orders, np.arccos(nodes))) @ values)
    series[0] *= 0.5
    return _single(series)


class BlockWeights(NamedTuple):
    """Weights of all encoder blocks, stacked; maps are (layers, inputs, outputs), shifts (layers, outputs).

    Layer norms and the scale 1 / sqrt(d_k) of the scores are folded into them.
    """

    query: Single
    query_shift: Single
    key_value: Single
    key_value_shift: Single
    project: Single
    project_shift: Single
    expand: Single
    expand_shift: Single
    contract: Single
    contract_shift: Single


class RiskWeights(NamedTuple):
    """All weights; `embed` is (features, width), `kinds` (3, width), `head` (width,), `head_shift` (1,)."""

    embed: Single
    kinds: Single
    blocks: BlockWeights
    head: Single
    head_shift: Single


def fold(state: Mapping[str, npt.NDArray[np.float32]], layers: int, heads: int) -> RiskWeights:
    """Weights of a `RiskNetwork`, by name, in the form that the kernel takes."""
    exact = {name: np.asarray(value, np.float64) for name, value in state.items()}

    def linear(name: str, norm: str | None = None) -> tuple[FloatArray, FloatArray]:
        matrix, shift = exact[f"{name}.weight"].T, exact[f"{name}.bias"]
        if norm is None:
            return matrix, shift
        return exact[f"{norm}.weight"][:, None] * matrix, shift + exact[f"{norm}.bias"] @ matrix

    stacks: list[list[FloatArray]] = [[] for _ in BlockWeights._fields]
    for k in range(layers):
        block = f"blocks.{k}"
        pack, pack_shift = linear(f"{block}.query_key_value", f"{block}.norm_attention")
        width = len(pack_shift) // 3
        scale = 1.0 / math.sqrt(width // heads)
        maps = (
            (pack[:, :width] * scale, pack_shift[:width] * scale),
            (pack[:, width:], pack_shift[width:]),
            linear(f"{block}.project"),
            linear(f"{block}.expand", f"{block}.norm_mlp"),
            linear(f"{block}.contract"),
        )
        for at, (matrix, shift) in enumerate(maps):
            stacks[2 * at].append(matrix)
            stacks[2 * at + 1].append(shift)
    head, head_shift = linear("head", "norm")
    blocks = BlockWeights(*(_single(np.stack(stack)) for stack in stacks))
    embed = _single(exact["embed.weight"].T)
    return RiskWeights(embed, _single(exact["kind.weight"]), blocks, _single(head[:, 0]), _single(head_shift))


def _single(values: FloatArray) -> Single:
    return np.ascontiguousarray(values, np.float32)


ERF_SERIES: Final = erf_series()


# Loops below index from 0 and take no slices: numba's checks of a slice, and of an index that it cannot prove to be
# positive, cost half the time of loops as short as these, mostly because they then work on one number at a time.


@njit
def _affine(x: Single, rows: int, matrix: Single, shift: Single, out: Single) -> None:
    """Rows of out: x matrix + shift; inputs four at a time."""
    for t in range(rows):
        for j in range(matrix.shape[1]):
            out[t, j] = shift[j]
        for quarter in range(matrix.shape[0] // 4):
            k = 4 * quarter
            a, b, c, d = x[t, k], x[t, k + 1], x[t, k + 2], x[t, k + 3]
            for j in range(matrix.shape[1]):
                out[t, j] += (a * matrix[k, j] + b * matrix[k + 1, j]) + (c * matrix[k + 2, j] + d * matrix[k + 3, j])


@njit
def _normalise(z: Single, rows: int, out: Single) -> None:
    """Rows of out: rows of z less their mean, over their standard deviation."""
    width = z.shape[1]
    for t in range(rows):
        mean = np.float32(0.0)
        for k in range(width):
            mean += z[t, k]
        mean /= np.float32(width)
        variance = np.float32(0.0)
        for k in range(width):
            variance += (z[t, k] - mean) * (z[t, k] - mean)
        factor = ONE / np.float32(math.sqrt(variance / np.float32(width) + NORM_EPSILON))
        for k in range(width):
            out[t, k] = (z[t, k] - mean) * factor


@njit
def _read_tokens(row: Single, weights: RiskWeights, z: Single, slots: npt.NDArray[np.int64]) -> int:
    """Embed ego and present objects into rows of z, their slots (-1: ego) into `slots`; how many there are."""
    count = 0
    for slot in range(-1, VEHICLE_SLOTS + PEDESTRIAN_SLOTS):
        if slot >= 0 and not row[VEHICLE_MASK_AT + slot] > HALF:
            continue
        slots[count] = slot
        kind, at, features = 0, 0, EGO_FEATURES
        if slot >= VEHICLE_SLOTS:
            kind, at = 2, PEDESTRIANS_AT + PEDESTRIAN_FEATURES * (slot - VEHICLE_SLOTS)
            features = PEDESTRIAN_FEATURES
        elif slot >= 0:
            kind, at, features = 1, VEHICLES_AT + VEHICLE_FEATURES * slot, VEHICLE_FEATURES
        z[count, :] = weights.kinds[kind]
        for k in range(features):
            # A pedestrian's third feature, v_d, takes the place of a vehicle's fourth.
            place = 3 if kind == 2 and k == 2 else k
            for j in range(z.shape[1]):
                z[count, j] += row[at + k] * weights.embed[place, j]
        count += 1
    return count


@njit
def _share(queries: Single, keys_values: Single, t: int, h: int, count: int, share: Single) -> None:
    """Attention of token t to the first `count` tokens in head h: softmax of the scores."""
    top = np.float32(-np.inf)
    for u in range(count):
        score = np.float32(0.0)
        for c in range(queries.shape[2]):
            score += queries[t, h, c] * keys_values[u, 0, h, c]
        share[u] = score
        top = max(top, score)
    total = np.float32(0.0)
    for u in range(count):
        share[u] = np.float32(math.exp(share[u] - top))
        total += share[u]
    for u in range(count):
        share[u] /= total


@njit
def _attend(
    queries: Single, keys_values: Single, rows: int, count: int, share: Single, mixed: Single, mean: Single
) -> None:
    """Attention of the first rows to all tokens: weighted values into `mixed`, the ego's head mean into `mean`.

    `queries` and `mixed` are (tokens, heads, size), `keys_values` (tokens, 2, heads, size), `share` is room to work in.
    """
    heads, size = mixed.shape[1:]
    for u in range(count):
        mean[u] = np.float32(0.0)
    for t in range(rows):
        for h in range(heads):
            _share(queries, keys_values, t, h, count, share)
            for c in range(size):
                mixed[t, h, c] = np.float32(0.0)
            for u in range(count):
                if t == 0:
                    mean[u] += share[u] / np.float32(heads)
                for c in range(size):
                    mixed[t, h, c] += share[u] * keys_values[u, 1, h, c]


@njit
def _gelu(wide: Single, rows: int) -> None:
    """Gaussian error linear unit x (1 + erf(x / sqrt 2)) / 2, in place; erf by Clenshaw's sum, which vectorises."""
    for t in range(rows):
        for j in range(wide.shape[1]):
            x = wide[t, j] * ROOT_HALF
            x = ERF_EDGE if x > ERF_EDGE else x  # min and max do not vectorise
            x = -ERF_EDGE if x < -ERF_EDGE else x
            twice = x * x * ERF_SCALE - TWO
            ahead, sum_k = np.float32(0.0), np.float32(0.0)
            for k in range(len(ERF_SERIES) - 1, 0, -1):
                ahead, sum_k = sum_k, twice * sum_k - ahead + ERF_SERIES[k]
            wide[t, j] *= HALF * (ONE + x * (HALF * twice * sum_k - ahead + ERF_SERIES[0]))


@njit
def _add(z: Single, change: Single, rows: int) -> None:
    for t in range(rows):
        for k in range(z.shape[1]):
            z[t, k] += change[t, k]


@njit
def rank_objects_by(attention: Single, count: int, slots: npt.NDArray[np.int64], out: FloatArray) -> None:
    """IR by slot, (8,), from the attention of the ego's token to the first `count` tokens, the ego's own first.

    Where all of it is on the ego itself, so that the rest underflows to 0, present objects share equally.
    """
    out[:] = 0.0
    total = np.float32(0.0)
    for u in range(1, count):
        total += attention[u]
    for u in range(1, count):
        out[slots[u]] = ONE / np.float32(count - 1) if total == 0.0 else attention[u] / total


@njit
def risk_kernel(
    observations: Single, weights: RiskWeights, heads: int, values: FloatArray, importance: FloatArray
) -> None:
    """Value of the head and IR of every world; the last two arrays are written.

    Args:
        observations: Shape (N, 47).
        weights: What `fold` gave.
        heads: Attention heads.
        values: Written, shape (N,).
        importance: Written, shape (N, 8): the last block's attention of the ego's token, mean of the heads,
            renormalised over present objects (`rank_objects_by`); 0 where a slot is empty.
    """
    blocks = weights.blocks
    layers, width, hidden = blocks.expand.shape
    size = width // heads
    z, normal = np.empty((TOKENS, width), np.float32), np.empty((TOKENS, width), np.float32)
    queries, mixed = np.empty((TOKENS, width), np.float32), np.empty((TOKENS, width), np.float32)
    keys_values, wide = np.empty((TOKENS, 2 * width), np.float32), np.empty((TOKENS, hidden), np.float32)
    queries_by_head, mixed_by_head = queries.reshape(TOKENS, heads, size), mixed.reshape(TOKENS, heads, size)
    keys_values_by_head = keys_values.reshape(TOKENS, 2, heads, size)
    share, mean, slots = np.empty(TOKENS, np.float32), np.empty(TOKENS, np.float32), np.empty(TOKENS, np.int64)
    for i in range(observations.shape[0]):
        count = _read_tokens(observations[i], weights, z, slots)
        for k in range(layers):
            rows = 1 if k == layers - 1 else count
            _normalise(z, count, normal)
            _affine(normal, rows, blocks.query[k], blocks.query_shift[k], queries)
            _affine(normal, count, blocks.key_value[k], blocks.key_value_shift[k], keys_values)
            _attend(queries_by_head, keys_values_by_head, rows, count, share, mixed_by_head, mean)
            _affine(mixed, rows, blocks.project[k], blocks.project_shift[k], normal)
            _add(z, normal, rows)
            _normalise(z, rows, normal)
            _affine(normal, rows, blocks.expand[k], blocks.expand_shift[k], wide)
            _gelu(wide, rows)
            _affine(wide, rows, blocks.contract[k], blocks.contract_shift[k], mixed)
            _add(z, mixed, rows)
        _normalise(z, 1, normal)
        value = weights.head_shift[0]
        for j in range(width):
            value += normal[0, j] * weights.head[j]
        values[i] = value
        rank_objects_by(mean, count, slots, importance[i])

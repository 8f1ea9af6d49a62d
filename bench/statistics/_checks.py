"""Input checks shared by the statistics: every refusal names the value and the remedy."""

from __future__ import annotations

import operator
from typing import SupportsIndex

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def count(name: str, value: SupportsIndex, minimum: int = 0) -> int:
    """A whole number at or above `minimum`; raises ValueError for anything else."""
    try:
        number = operator.index(value)
    except TypeError as error:
        raise ValueError(f"{name} is {value!r}: pass a whole number") from error
    if number < minimum:
        raise ValueError(f"{name} is {number}: pass a count of at least {minimum}")
    return number


def fraction(name: str, value: float) -> float:
    """A number strictly between 0 and 1; raises ValueError for anything else."""
    number = float(value)
    if not 0.0 < number < 1.0:
        raise ValueError(f"{name} is {value!r}: pass a number between 0 and 1, such as 0.95")
    return number


def real_array(name: str, values: npt.ArrayLike, ndim: int) -> FloatArray:
    """Finite values as float64 with the stated number of axes; raises ValueError otherwise."""
    array = np.asarray(values)
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{name} has dtype {array.dtype}: pass real numbers, rows of equal length")
    if array.ndim != ndim:
        raise ValueError(f"{name} has shape {array.shape}: reshape it to {ndim} axes")
    if array.size == 0:
        raise ValueError(f"{name} is empty, shape {array.shape}: pass at least one value")
    result = array.astype(np.float64)
    bad = np.flatnonzero(~np.isfinite(result))
    if bad.size:
        raise ValueError(f"{name} holds {result.flat[bad[0]]} at flat index {bad[0]}: drop or repair that run")
    return result


def count_array(name: str, values: npt.ArrayLike) -> IntArray:
    """Whole numbers >= 0, shape (seeds,), as int64; raises ValueError otherwise."""
    array = real_array(name, values, ndim=1)
    bad = np.flatnonzero((array < 0) | (array != np.floor(array)))
    if bad.size:
        raise ValueError(f"{name} holds {array[bad[0]]:g} at index {bad[0]}: pass whole numbers >= 0")
    return array.astype(np.int64)


def binary_array(name: str, values: npt.ArrayLike, ndim: int) -> FloatArray:
    """Zeros and ones with the stated number of axes, as float64; raises ValueError otherwise."""
    array = real_array(name, values, ndim)
    bad = np.flatnonzero((array != 0.0) & (array != 1.0))
    if bad.size:
        raise ValueError(f"{name} holds {array.flat[bad[0]]:g} at flat index {bad[0]}: pass 0 or 1 per episode")
    return array


def same_shape(first_name: str, first: FloatArray, second_name: str, second: FloatArray) -> None:
    """Raise ValueError unless both arrays have one shape."""
    if first.shape != second.shape:
        raise ValueError(
            f"{first_name} has shape {first.shape} but {second_name} has {second.shape}: "
            "pass values of the same runs and samples"
        )


def generator(rng: np.random.Generator) -> np.random.Generator:
    """A numpy Generator; raises ValueError for a seed or a legacy RandomState."""
    if not isinstance(rng, np.random.Generator):
        raise ValueError(f"rng is {rng!r}: pass numpy.random.default_rng(seed)")
    return rng

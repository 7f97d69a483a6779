"""Types and array helpers that the packages share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
# Of any precision: what numpy's own signatures give.
RealArray = NDArray[np.floating[Any]]
ComplexArray = NDArray[np.complex128]
BoolArray = NDArray[np.bool_]
# Called with the name of a stage and its completed part.
Progress = Callable[[str, float], None]

_ROWS_TOGETHER = 64


def real_array(values: ArrayLike) -> FloatArray:
    """Return a copy of numbers as doubles; TypeError for complex ones, dates and time differences.

    numpy would take the real part, or the count of a unit that hangs on where they come from.
    """
    found = np.asarray(values)
    if found.dtype.kind in "cmM":
        raise TypeError(found.dtype)
    return np.array(found, dtype=np.float64, order="C")


def runs(mask: BoolArray) -> NDArray[np.intp]:
    """Return the runs of true values in a mask, (runs, 2): first rows, and rows behind."""
    edges = np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8))
    return np.asarray(np.flatnonzero(edges).reshape(-1, 2))


def column_range(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and the largest value of each column of (samples, channels).

    Many rows are compared at once: numpy is ten times slower along rows of few values.
    """
    samples, channels = values.shape
    whole = samples // _ROWS_TOGETHER * _ROWS_TOGETHER
    wide = values[:whole].reshape(-1, _ROWS_TOGETHER * channels)
    extremes = []
    for reduction in (np.minimum, np.maximum):
        parts = [values[whole:]]
        if whole:
            parts.append(reduction.reduce(wide, axis=0).reshape(-1, channels))
        extremes.append(reduction.reduce(np.concatenate(parts), axis=0))
    return extremes[0], extremes[1]

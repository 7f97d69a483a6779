"""Eigenmodes of a structure with banded matrices, to the last digit the same on every machine.

A library for linear algebra takes the fastest kernel of a processor, and rounds as that kernel
does. The modes of a beam, which is very stiff in the last of them, then differ in the ninth digit,
and friction in a loop makes other motions of that. Here the library finds the modes, and a few
steps of inverse iteration [1]_ in plain arithmetic take its rounding away.

References
----------
.. [1] Parlett, B. N. (1998). The Symmetric Eigenvalue Problem. SIAM. Chapter 4.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import scipy

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Rows: TypeAlias = list[list[float]]

# The kernels agree in as many digits of an eigenvalue, and of a shape in units of its largest part.
_COMMON_DIGITS = 4
# Each step makes the difference of two starts some hundred times smaller.
_STEPS = 8


def eigenmodes(
    stiffness: NDArray[np.float64], mass: NDArray[np.float64], count: int, bandwidth: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the slowest flexible modes of a structure with one rigid mode.

    Parameters
    ----------
    stiffness, mass : ndarray, (dofs, dofs)
        Symmetric matrices; the eigenvalues are distinct.
    count : int
        Number of flexible modes.
    bandwidth : int
        Diagonals on either side of the main one that are not zero.

    Returns
    -------
    squares : ndarray, (count,)
        Squares of the angular frequencies, ascending.
    shapes : ndarray, (dofs, count)
        Shapes, normalised to unit modal mass; their sign is open.
    """
    found, starts = scipy.linalg.eigh(stiffness, mass, subset_by_index=(1, count))
    squares, shapes = np.empty(count), np.empty((len(mass), count))
    mass_rows = _banded(mass, bandwidth)
    for mode, (square, start) in enumerate(zip(found.tolist(), starts.T, strict=True)):
        shift = float(f"{square:.{_COMMON_DIGITS}g}")
        factor = _factored(_banded(stiffness - shift * mass, bandwidth))
        largest = np.argmax(np.abs(start))
        shape = np.round(start / start[largest], _COMMON_DIGITS).tolist()
        gain = 0.0
        for _ in range(_STEPS):
            driven = _times(mass_rows, shape)
            moved = _solved(factor, driven)
            gain = _product(moved, driven) / _product(shape, driven)
            length = _product(moved, _times(mass_rows, moved)) ** 0.5
            shape = [each / length for each in moved]
        squares[mode], shapes[:, mode] = shift + 1.0 / gain, shape
    return squares, shapes


def _banded(matrix: NDArray[np.float64], bandwidth: int) -> Rows:
    """Return each row of a symmetric matrix from its diagonal on."""
    return [matrix[k, k : k + bandwidth + 1].tolist() for k in range(len(matrix))]


def _factored(rows: Rows) -> Rows:
    """Return the rows of L' D L: the diagonal of D, then what L' has beside its unit diagonal."""
    rows = [row[:] for row in rows]
    for k, (pivot, *beside) in enumerate(rows):
        factors = [each / pivot for each in beside]
        for i, factor in enumerate(factors):
            for j in range(i, len(beside)):
                rows[k + 1 + i][j - i] -= factor * beside[j]
        rows[k] = [pivot, *factors]
    return rows


def _solved(factor: Rows, right: list[float]) -> list[float]:
    solution = right[:]
    for k, (_, *factors) in enumerate(factor):
        for i, each in enumerate(factors, start=1):
            solution[k + i] -= each * solution[k]
    for k in reversed(range(len(factor))):
        pivot, *factors = factor[k]
        value = solution[k] / pivot
        for i, each in enumerate(factors, start=1):
            value -= each * solution[k + i]
        solution[k] = value
    return solution


def _times(rows: Rows, vector: list[float]) -> list[float]:
    """Return the product of a symmetric matrix, given by `_banded`, and a vector."""
    result = [0.0] * len(vector)
    for k, (diagonal, *beside) in enumerate(rows):
        result[k] += diagonal * vector[k]
        for i, each in enumerate(beside, start=1):
            result[k] += each * vector[k + i]
            result[k + i] += each * vector[k]
    return result


def _product(one: list[float], other: list[float]) -> float:
    # In the order of the entries: a library's sum goes by the width of the processor's registers.
    total = 0.0
    for a, b in zip(one, other, strict=True):
        total += a * b
    return total

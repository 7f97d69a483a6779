"""Truncated inverse and factor of a product matrix."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray

_SMALLEST_EIGENVALUE = 1e-13
# Part of the largest scale below which a direction is empty.
_NOTHING = 1e-100


class TruncatedInverse(NamedTuple):
    """Inverse over the directions above rounding.

    Attributes
    ----------
    vectors : ndarray, (size, rank)
        Eigenvectors, in the units of the matrix.
    values : ndarray, (rank,)
        Their eigenvalues.
    condition : float
        Condition number of the whole matrix, scaled if asked for.
    """

    vectors: NDArray[Any]
    values: FloatArray
    condition: float

    @property
    def rank(self) -> int:
        """Number of kept directions."""
        return len(self.values)

    @property
    def root(self) -> NDArray[Any]:
        """Root of the inverse, (size, rank): the inverse is ``root @ root.conj().T``."""
        return np.asarray(self.vectors / np.sqrt(self.values))

    def solve(self, right: NDArray[Any]) -> NDArray[Any]:
        """Return the inverse times a matrix or a vector."""
        along = self.vectors.conj().T @ right
        return np.asarray(self.vectors @ (along.T / self.values).T)


def truncated_inverse(
    matrix: NDArray[Any], *, smallest: float = _SMALLEST_EIGENVALUE, equilibrated: bool = False
) -> TruncatedInverse:
    """Return the truncated inverse of a symmetric or Hermitian matrix, (size, size).

    The matrix is positive semidefinite but for rounding. Directions below the part `smallest` of
    the largest eigenvalue are left out, after scaling to a unit diagonal if `equilibrated`.
    """
    scale = np.ones(len(matrix))
    if equilibrated:
        # Rounding can make the power of an empty direction negative.
        scale = np.sqrt(np.diag(matrix).real.clip(min=0.0))
        # What dies away before the first sample has a power whose inverse overflows.
        scale[scale <= _NOTHING * scale.max()] = 1.0
        matrix = matrix / np.outer(scale, scale)
    values, vectors = scipy.linalg.eigh(matrix, driver="evd")
    kept = values > smallest * values[-1]
    largest = float(values[-1])
    rounding = np.finfo(float).eps * largest
    condition = largest / max(float(values[0]), rounding) if largest > 0.0 else np.inf
    vectors = vectors[:, kept] / scale[:, np.newaxis]
    return TruncatedInverse(vectors, values[kept], condition)


def factor(matrix: FloatArray) -> FloatArray:
    """Return R with ``R @ R.T`` the symmetric matrix, (size, size), of any rank.

    It is positive semidefinite but for rounding. Where it is clear of that, Cholesky's factor takes
    a tenth of the time of the eigenvectors.
    """
    try:
        return np.asarray(scipy.linalg.cholesky(matrix, lower=True))
    except scipy.linalg.LinAlgError:
        values, vectors = scipy.linalg.eigh(matrix, driver="evd")
        return np.asarray(vectors * np.sqrt(values.clip(min=0.0)))

"""Truncated inverse and factor of a product matrix."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray

_SMALLEST_EIGENVALUE = 1e-13
# Part of the largest scale below which a direction is empty.
_NOTHING = 1e-100
# Ratio of the smallest eigenvalue that is kept to one that is clear of it.
_CLEAR = 1e-2


@dataclass(frozen=True, eq=False)
class TruncatedInverse:
    """Inverse over the directions above rounding.

    Attributes
    ----------
    root : ndarray, (size, rank)
        Root of the inverse, in the units of the matrix: the inverse is ``root @ root.conj().T``.
    scaled : ndarray, (size, size)
        The matrix, scaled if asked for.
    """

    root: NDArray[Any]
    scaled: NDArray[Any]

    @property
    def rank(self) -> int:
        """Number of kept directions."""
        return int(self.root.shape[1])

    @cached_property
    def condition(self) -> float:
        """Condition number of the whole matrix, scaled if asked for."""
        values = scipy.linalg.eigvalsh(self.scaled)
        largest = float(values[-1])
        rounding = np.finfo(float).eps * largest
        return largest / max(float(values[0]), rounding) if largest > 0.0 else np.inf

    def solve(self, right: NDArray[Any]) -> NDArray[Any]:
        """Return the inverse times a matrix or a vector."""
        return np.asarray(self.root @ (self.root.conj().T @ right))


def truncated_inverse(
    matrix: NDArray[Any], *, smallest: float = _SMALLEST_EIGENVALUE, equilibrated: bool = False
) -> TruncatedInverse:
    """Return the truncated inverse of a symmetric or Hermitian matrix, (size, size).

    The matrix is positive semidefinite but for rounding. Directions below the part `smallest` of
    the largest eigenvalue are left out, after scaling to a unit diagonal if `equilibrated`. Where
    no eigenvalue is near it, Cholesky's factor takes a tenth of the time of the eigenvectors.
    """
    scale = np.ones(len(matrix))
    if equilibrated:
        # Rounding can make the power of an empty direction negative.
        scale = np.sqrt(np.diag(matrix).real.clip(min=0.0))
        # What dies away before the first sample has a power whose inverse overflows.
        scale[scale <= _NOTHING * scale.max()] = 1.0
        matrix = matrix / np.outer(scale, scale)
    root = _whole_root(matrix, smallest)
    if root is None:
        values, vectors = scipy.linalg.eigh(matrix, driver="evd")
        kept = values > smallest * values[-1]
        root = vectors[:, kept] / np.sqrt(values[kept])
    return TruncatedInverse(root / scale[:, np.newaxis], matrix)


def _whole_root(matrix: NDArray[Any], smallest: float) -> NDArray[Any] | None:
    """Return a root of the inverse, (size, size); None unless all eigenvalues are clearly kept."""
    try:
        upper = scipy.linalg.cholesky(matrix)
    except scipy.linalg.LinAlgError:
        return None
    invert = scipy.linalg.lapack.ztrtri if upper.dtype.kind == "c" else scipy.linalg.lapack.dtrtri
    root, _ = invert(upper)
    # The traces of the matrix and of its inverse are above the largest eigenvalues of both.
    # BLAS takes the length of a vector without an overflow of its squares.
    length = float(scipy.linalg.norm(root.ravel()))
    condition_root = np.sqrt(np.trace(matrix).real) * length
    return np.asarray(root) if condition_root < np.sqrt(_CLEAR / smallest) else None


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

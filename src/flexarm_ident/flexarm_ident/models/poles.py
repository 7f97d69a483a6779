"""Policy for unstable eigenvalues (section 3.2, third example)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray

STABLE_RADIUS = 0.9999


def is_stable(A: FloatArray) -> bool:
    """Whether all eigenvalues lie inside the unit circle."""
    return bool(np.abs(np.linalg.eigvals(A)).max(initial=0.0) < 1.0)


def stabilise(A: FloatArray) -> tuple[FloatArray, int]:
    """Move the eigenvalues on or outside the unit circle inside, keeping the other modes.

    An eigenvalue is mirrored at the circle, which keeps its frequency and turns growth into decay
    of the same rate, but not closer than 0.9999, the thesis's value for 1.0000235.

    Parameters
    ----------
    A : ndarray, (states, states)
        State matrix.

    Returns
    -------
    ndarray, (states, states)
        The stable matrix; `A` itself when it is stable already.
    int
        Number of eigenvalues that were moved.
    """
    eigenvalues, vectors = np.linalg.eig(A)
    radius = np.abs(eigenvalues)
    outside = radius >= 1.0
    if not outside.any():
        return A, 0
    target = np.where(outside, np.minimum(1.0 / radius, STABLE_RADIUS), radius)
    moved = eigenvalues * np.divide(target, radius, out=np.ones_like(radius), where=radius > 0.0)
    stable = np.linalg.solve(vectors.T, (vectors * moved).T).T.real
    largest = np.abs(np.linalg.eigvals(stable)).max()
    if largest >= 1.0:
        # Eigenvectors too close to each other to move one alone.
        stable = stable * (STABLE_RADIUS / largest)
    return stable, int(outside.sum())

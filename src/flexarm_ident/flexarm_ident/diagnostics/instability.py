"""Instability of the plant itself, told from eigenvalues that noise put outside the circle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_core.errors import IdentificationError
from flexarm_ident.fitting.output_fit import fit_inputs
from flexarm_ident.models.state_space import stabilise
from flexarm_ident.subspace.feedback import SIGNIFICANCE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData

FAR_OUTSIDE = 1.005
"""Magnitude of an eigenvalue that noise does not give to a model of a stable plant."""
_GROWTH = 20.0
# A simulation that grows by more shows its initial state and the rounding of its model alone.
_LARGEST_GROWTH = 1e4
_PIECES = 100


def short_samples(A: FloatArray) -> int:
    """Return the samples in which the response of an unstable A grows by 10,000."""
    largest = float(np.abs(np.linalg.eigvals(A)).max())
    return round(float(np.log(_LARGEST_GROWTH) / np.log(largest)))


def is_unstable(A: FloatArray, C: FloatArray, records: Sequence[IoData]) -> bool:
    """Return whether short pieces of the records follow A better than A with stable eigenvalues.

    Each piece has its own initial state and is so short that the response grows twentyfold.

    Parameters
    ----------
    A : ndarray, (states, states)
        State matrix as estimated.
    C : ndarray, (outputs, states)
        Output matrix.
    records : sequence of IoData
        Records of one rig, in memory.
    """
    largest = float(np.abs(np.linalg.eigvals(A)).max(initial=0.0))
    if largest < FAR_OUTSIDE:
        return False
    length = max(round(np.log(_GROWTH) / np.log(largest)), 4 * len(A))
    pieces = [
        record.rows(slice(first, first + length))
        for record in records
        for first in range(0, len(record) - length + 1, length)
    ][:_PIECES]
    if not pieces:
        return False
    try:
        own, moved = (_missed(each, C, pieces) for each in (A, stabilise(A)[0]))
    except IdentificationError:
        return False
    # A disturbance is in both errors: it hides their ratio, but not which of them is less. Those of
    # a stable plant's pieces are so by chance.
    better = np.count_nonzero(own < moved)
    return bool(better and scipy.special.bdtrc(better - 1, len(pieces), 0.5) < SIGNIFICANCE)


def _missed(A: FloatArray, C: FloatArray, pieces: Sequence[IoData]) -> FloatArray:
    """Return each piece's squared errors, those of an output relative to its power in all."""
    fit = fit_inputs(A, C, pieces)
    missed = np.array(fit.missed)
    total = missed.sum(axis=0)
    weight = np.divide(fit.error**2, total, out=np.zeros_like(total), where=total > 0.0)
    return np.asarray(missed @ weight)

"""Observability range space from the block Gram, and A, C from its shift (2-18 .. 2-23).

Plain ORSE takes the dominant eigenvectors of the outputs' Gram matrix after removal of the inputs'
part (2-20). They are biased when the channels differ in noise, for records of any length. Here each
output is divided by the standard deviation of its one-step innovation, from the last block of a
Cholesky factor of the same matrix, so that the noise of all channels has the same weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_core.errors import IdentificationError
from flexarm_ident.subspace.feedback import reaches_inputs
from flexarm_ident.subspace.gram import equilibrated
from flexarm_ident.subspace.inverse import truncated_inverse
from flexarm_ident.subspace.subspace_protocol import StateMatrices, normalised

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.subspace.gram import BlockGram

# An innovation below this part of an output's RMS is rounding, not noise.
_SMALLEST_INNOVATION = 1e-6
_CLEAN = 1e-5
# Noise power in one direction, in units of the one-step innovation's; less is rounding.
_SMALLEST_NOISE = 1e-4


@dataclass(frozen=True)
class RangeSpace:
    """Base vectors of the observability range space (2-21), (2-23), of scaled outputs.

    Attributes
    ----------
    basis : ndarray, (block_rows * outputs, vectors)
        Orthonormal base vectors, the most significant first.
    singular_values : ndarray, (block_rows * outputs,)
        Singular values of (2-21), descending.
    output_scale : ndarray, (outputs,)
        Factors the outputs were multiplied by.
    condition : float
        Condition number of the inputs' product matrix U U'.
    """

    basis: FloatArray
    singular_values: FloatArray
    output_scale: FloatArray
    condition: float

    @property
    def block_rows(self) -> int:
        """Number of block rows in the basis, q of (2-7)."""
        return len(self.basis) // len(self.output_scale)

    @property
    def largest_order(self) -> int:
        """Largest order that the shift (2-10) determines."""
        return int(min((self.block_rows - 1) * len(self.output_scale), self.basis.shape[1]))

    def matrices(self, order: int) -> StateMatrices:
        """Return A and C from the shift structure, by least squares (2-9), (2-10).

        Raises
        ------
        IdentificationError
            If the block rows do not determine as many states.
        """
        outputs = len(self.output_scale)
        if not 1 <= order <= self.largest_order:
            raise IdentificationError(
                f"order must lie between 1 and {self.largest_order} for {self.block_rows} block "
                f"rows of {outputs} outputs: {order}; lower it, or raise block_rows or excite more"
            )
        basis = self.basis[:, :order]
        A = np.linalg.lstsq(basis[:-outputs], basis[outputs:], rcond=None)[0]
        C = basis[:outputs] / self.output_scale[:, np.newaxis]
        return StateMatrices(np.asarray(A, dtype=np.float64), normalised(C))


def innovation_scaled(gram: BlockGram) -> RangeSpace:
    """Return the range space of outputs scaled by their one-step innovation."""
    remainder, rms, condition = _output_remainder(gram)
    deviation = _innovation_deviation(remainder, gram.outputs)
    return _range_space(remainder, 1.0 / deviation, rms, condition)


def plain(gram: BlockGram, output_scale: FloatArray) -> RangeSpace:
    """Return the range space by the thesis's scaling, for comparison.

    `output_scale`, (outputs,), holds the factors of section 2.5, step 4.
    """
    remainder, rms, condition = _output_remainder(gram)
    return _range_space(remainder, output_scale * rms, rms, condition)


def past_instruments(gram: BlockGram) -> RangeSpace:
    """Return the range space of the future that past data explain, weighted by the rest.

    The first half of the block rows is the past, the second the future. Coloured noise drops out,
    because it is uncorrelated with the instruments. The outputs are scaled by their innovation. Two
    further weights are in use:

    - CVA: the future is whitened by the covariance of its unexplained part, so that directions with
      strong noise count less.
    - PO-MOESP: no further weight. It is taken for data without noise, and where later inputs are
      correlated with the innovation (`reaches_inputs`). The unexplained part then contains feedback
      or friction, and a model of low order has to follow the strongest motion.

    Verhaegen, "Identification of the deterministic part of MIMO state space models given in
    innovations form from input-output data", Automatica 30 (1994); Larimore, "Canonical variate
    analysis in identification, filtering, and adaptive control", CDC 1990.

    Parameters
    ----------
    gram : BlockGram
        Products of the data, with twice the block rows of the basis.
    """
    past, both = gram.block_rows // 2, gram.block_rows
    scaled, rms = equilibrated(gram)
    u_future = gram.input_rows(past, both)
    z_past = gram.input_rows(0, past) + gram.output_rows(0, past)
    y_future = gram.output_rows(past, both)
    remainder, condition = _schur_complement(scaled, z_past + y_future, u_future)
    w = len(z_past)
    explained = remainder[w:, :w] @ truncated_inverse(remainder[:w, :w]).root
    unexplained = remainder[w:, w:] - explained @ explained.T
    deviation = _innovation_deviation(unexplained, gram.outputs, remainder[w:, w:])
    weight = np.tile(1.0 / deviation, both - past)
    explained *= weight[:, np.newaxis]
    output_scale = 1.0 / (deviation * rms[: gram.outputs])
    if _is_clean(deviation, remainder) or reaches_inputs(gram.leading(both - past)):
        basis, singular_values, _ = scipy.linalg.svd(explained, full_matrices=False)
        return RangeSpace(basis, singular_values, output_scale, condition)
    whiten, colour = _whitening(unexplained * np.outer(weight, weight))
    directions, singular_values, _ = scipy.linalg.svd(whiten @ explained, full_matrices=False)
    # Leading columns keep their span.
    basis = scipy.linalg.qr(colour @ directions, mode="economic")[0]
    return RangeSpace(basis, singular_values, output_scale, condition)


def _is_clean(deviation: FloatArray, power: FloatArray) -> bool:
    """Return whether the innovation of any output is mostly rounding."""
    total = np.sqrt(np.diag(power)[-len(deviation) :].clip(min=0.0))
    return bool(np.any(deviation < _CLEAN * total))


def _whitening(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the map that makes a covariance the identity, and its inverse."""
    values, vectors = scipy.linalg.eigh(covariance, driver="evd")
    root = np.sqrt(values.clip(min=_SMALLEST_NOISE))
    return (vectors / root).T, vectors * root


def _output_remainder(gram: BlockGram) -> tuple[FloatArray, FloatArray, float]:
    scaled, rms = equilibrated(gram)
    y = gram.output_rows(0, gram.block_rows)
    u = gram.input_rows(0, gram.block_rows)
    remainder, condition = _schur_complement(scaled, y, u)
    return remainder, rms[: gram.outputs], condition


def _schur_complement(
    gram: FloatArray, keep: list[int], given: list[int]
) -> tuple[FloatArray, float]:
    """Return the remainder of `keep` given `given` (2-20), and the condition number of `given`."""
    inverse = truncated_inverse(gram[np.ix_(given, given)])
    cross = gram[np.ix_(keep, given)] @ inverse.root
    return gram[np.ix_(keep, keep)] - cross @ cross.T, inverse.condition


def _innovation_deviation(
    remainder: FloatArray, outputs: int, power: FloatArray | None = None
) -> FloatArray:
    """Return the deviation of the last outputs given all before them, floored for clean data."""
    total = np.sqrt(np.diag(remainder if power is None else power)[-outputs:].clip(min=0.0))
    floor = np.where(total > 0.0, _SMALLEST_INNOVATION * total, 1.0)
    try:
        last = scipy.linalg.cholesky(remainder, lower=True)[-outputs:, -outputs:]
        deviation = np.linalg.norm(last, axis=1)
    except np.linalg.LinAlgError:
        rows = list(range(len(remainder)))
        last, _ = _schur_complement(remainder, rows[-outputs:], rows[:-outputs])
        deviation = np.sqrt(np.diag(last).clip(min=0.0))
    return np.asarray(np.maximum(deviation, floor))


def _range_space(
    remainder: FloatArray, weight: FloatArray, rms: FloatArray, condition: float
) -> RangeSpace:
    rows = np.tile(weight, len(remainder) // len(weight))
    values, vectors = scipy.linalg.eigh(remainder * np.outer(rows, rows), driver="evd")
    return RangeSpace(vectors[:, ::-1], values[::-1].clip(min=0.0), weight / rms, condition)

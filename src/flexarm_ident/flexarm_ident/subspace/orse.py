"""Observability range space from the block Gram, and A, C from its shift (2-18 .. 2-23).

With the outputs Y and the inputs U in block Hankel matrices (2-19), the part of the outputs'
products that the inputs do not explain is the remainder (2-20)

    R = Y Y' - Y U' (U U')^-1 U Y'

Its dominant eigenvectors span the range of the observability matrix (2-21), (2-23), whose shift
structure gives A and C (2-9), (2-10). All products are blocks of one Gram matrix.

Plain ORSE takes R as it is. Its eigenvectors are biased when the channels differ in noise, for
records of any length. Here each output is divided by the standard deviation of its one-step
innovation, from the last block of a Cholesky factor of R, so that the noise of all channels has
the same weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_core.errors import IdentificationError
from flexarm_ident.subspace.feedback import SMALLEST_REMAINDER, reaches_inputs
from flexarm_ident.subspace.gram import equilibrated
from flexarm_ident.subspace.inverse import truncated_inverse
from flexarm_ident.subspace.subspace_protocol import SMALLEST_INNOVATION, StateMatrices, normalised

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.subspace.gram import BlockGram

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
    """

    basis: FloatArray
    singular_values: FloatArray
    output_scale: FloatArray

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


class _Remainder(NamedTuple):
    """Products of the outputs without the inputs' part, R of (2-20).

    Attributes
    ----------
    products : ndarray, (block_rows * outputs,) * 2
        The remainder, of outputs with unit RMS.
    rms : ndarray, (outputs,)
        RMS of the outputs.
    """

    products: FloatArray
    rms: FloatArray


class _Future(NamedTuple):
    """Products of the future outputs without the future inputs' part, split by the past data.

    Attributes
    ----------
    products : ndarray, (rows, rows)
        Sum of both parts, of outputs with unit RMS; there are future block rows * outputs rows.
    explained : ndarray, (rows, directions of the past)
        Root F of the part F F' that the past data explain.
    unexplained : ndarray, (rows, rows)
        The other part: noise.
    rms : ndarray, (outputs,)
        RMS of the outputs.
    """

    products: FloatArray
    explained: FloatArray
    unexplained: FloatArray
    rms: FloatArray


def innovation_scaled(gram: BlockGram) -> RangeSpace:
    """Return the range space of outputs scaled by their one-step innovation."""
    remainder = _remainder(gram)
    deviation = _innovation_deviation(remainder.products, remainder.products, gram.outputs)
    return _range_space(remainder, 1.0 / deviation)


def plain(gram: BlockGram, output_scale: FloatArray) -> RangeSpace:
    """Return the range space by the thesis's scaling, for comparison.

    `output_scale`, (outputs,), holds the factors of section 2.5, step 4.
    """
    remainder = _remainder(gram)
    return _range_space(remainder, output_scale * remainder.rms)


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
    future = _future(gram)
    deviation = _innovation_deviation(future.unexplained, future.products, gram.outputs)
    block_rows = len(future.products) // gram.outputs
    weight = np.tile(1.0 / deviation, block_rows)
    explained = future.explained * weight[:, np.newaxis]
    driven = gram.inputs > 0 and reaches_inputs(gram.leading(block_rows))
    if driven or _is_clean(deviation, future.products):
        basis, singular_values = _po_moesp(explained)
    else:
        basis, singular_values = _cva(explained, future.unexplained * np.outer(weight, weight))
    output_scale = 1.0 / (deviation * future.rms)
    return RangeSpace(basis, singular_values, output_scale)


def _remainder(gram: BlockGram) -> _Remainder:
    """Return R of (2-20)."""
    scaled, rms = equilibrated(gram)
    y = gram.output_rows(0, gram.block_rows)
    u = gram.input_rows(0, gram.block_rows)
    return _Remainder(_schur_complement(scaled, y, u), rms[: gram.outputs])


def _range_space(remainder: _Remainder, weight: FloatArray) -> RangeSpace:
    """Return the eigenvectors of R (2-21), its outputs multiplied by `weight`, (outputs,)."""
    products, rms = remainder
    rows = np.tile(weight, len(products) // len(weight))
    values, vectors = scipy.linalg.eigh(products * np.outer(rows, rows), driver="evd")
    return RangeSpace(vectors[:, ::-1], values[::-1].clip(min=0.0), weight / rms)


def _future(gram: BlockGram) -> _Future:
    """Return the future that the past explains, and the rest; `past_instruments` has the halves."""
    past, both = gram.block_rows // 2, gram.block_rows
    scaled, rms = equilibrated(gram)
    u_future = gram.input_rows(past, both)
    z_past = gram.input_rows(0, past) + gram.output_rows(0, past)
    y_future = gram.output_rows(past, both)
    remainder = _schur_complement(scaled, z_past + y_future, u_future)
    z, y = slice(0, len(z_past)), slice(len(z_past), None)
    explained = remainder[y, z] @ truncated_inverse(remainder[z, z]).root
    unexplained = remainder[y, y] - explained @ explained.T
    return _Future(remainder[y, y], explained, unexplained, rms[: gram.outputs])


def _po_moesp(explained: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return base vectors of the explained future, and its singular values."""
    basis, singular_values, _ = scipy.linalg.svd(explained, full_matrices=False)
    return basis, singular_values


def _cva(explained: FloatArray, unexplained: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return base vectors of the explained future, and its singular values after whitening."""
    whiten, colour = _whitening(unexplained)
    directions, singular_values, _ = scipy.linalg.svd(whiten @ explained, full_matrices=False)
    # Each number of leading columns keeps its span, so the vectors serve every order.
    basis = scipy.linalg.qr(colour @ directions, mode="economic")[0]
    return np.asarray(basis, dtype=np.float64), singular_values


def _whitening(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the map that makes a covariance the identity, and its inverse."""
    values, vectors = scipy.linalg.eigh(covariance, driver="evd")
    root = np.sqrt(values.clip(min=_SMALLEST_NOISE))
    return (vectors / root).T, vectors * root


def _innovation_deviation(
    unexplained: FloatArray, products: FloatArray, outputs: int
) -> FloatArray:
    """Return the standard deviation of each output's one-step innovation, (outputs,).

    The innovation is what all block rows before the last do not explain of it, in the `unexplained`
    part of the outputs' `products`, both (block_rows * outputs,) * 2.
    """
    rms = _last_deviation(products, outputs)
    floor = np.where(rms > 0.0, SMALLEST_INNOVATION * rms, 1.0)
    try:
        last = scipy.linalg.cholesky(unexplained, lower=True)[-outputs:, -outputs:]
        deviation = np.linalg.norm(last, axis=1)
    except np.linalg.LinAlgError:
        # Clean data or repeated channels: the matrix is singular.
        rows = list(range(len(unexplained)))
        last = _schur_complement(unexplained, rows[-outputs:], rows[:-outputs])
        deviation = _last_deviation(last, outputs)
    return np.asarray(np.maximum(deviation, floor))


def _is_clean(deviation: FloatArray, products: FloatArray) -> bool:
    """Return whether the innovation of any output is mostly rounding."""
    return bool(np.any(deviation < SMALLEST_REMAINDER * _last_deviation(products, len(deviation))))


def _last_deviation(products: FloatArray, outputs: int) -> FloatArray:
    """Return the root of the last powers; rounding can make the power of nothing negative."""
    return np.asarray(np.sqrt(np.diag(products)[-outputs:].clip(min=0.0)))


def _schur_complement(gram: FloatArray, keep: list[int], given: list[int]) -> FloatArray:
    """Return the remainder of `keep` given `given` (2-20)."""
    ordered = gram[keep + given][:, keep + given]
    if not given:
        return ordered
    kept, known = slice(0, len(keep)), slice(len(keep), None)
    cross = ordered[kept, known] @ truncated_inverse(ordered[known, known]).root
    return np.asarray(ordered[kept, kept] - cross @ cross.T)

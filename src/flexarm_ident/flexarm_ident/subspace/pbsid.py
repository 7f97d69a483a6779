"""Predictor-based subspace identification (PBSID-opt) from the block Gram.

ORSE removes the future input from the future output, which requires an input uncorrelated with the
noise. Feedback violates that. Here the regression is on the past alone: a vector autoregressive
model with input of high order (VARX) gives the pulse responses of the innovation form's one-step
predictor. These give the states up to a similarity, and regressions on the states give the
matrices. All steps are linear algebra on the Gram matrix of one block row more than the past.
Chiuso, "The role of vector autoregressive modeling in predictor-based subspace identification",
Automatica 43 (2007).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_core.errors import IdentificationError
from flexarm_ident.subspace.gram import equilibrated
from flexarm_ident.subspace.inverse import factor, truncated_inverse
from flexarm_ident.subspace.subspace_protocol import (
    LARGEST_ORDER,
    SMALLEST_INNOVATION,
    StateMatrices,
    normalised,
)

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.subspace.gram import BlockGram

# Part of the largest eigenvalue above which an eigenvector has eight digits.
_CLEAR = 1e-8


class Innovation(NamedTuple):
    """Innovation form ``x' = A x + B u + K e``, ``y = C x + D u + e``, with the covariance of e."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    K: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class PredictorSpace:
    """States of the one-step predictor as functions of the past data.

    Attributes
    ----------
    basis : ndarray, (past * outputs, vectors)
        Map from the predicted outputs to the states, the most significant state first.
    predicted : ndarray, (past * outputs, past * (outputs + inputs))
        Map from the past to the predicted outputs, weighted.
    singular_values : ndarray, (past * outputs,)
        Singular values of the weighted predictor's future, descending.
    gram : ndarray
        Product matrix of the data, of channels with unit RMS.
    past : int
        Samples of the past, p.
    rms : ndarray, (outputs + inputs,)
        The channels' RMS.
    outputs : int
        Number of outputs.
    feedthrough : bool
        Whether the output may respond to the input at once (D).
    """

    basis: FloatArray
    predicted: FloatArray
    singular_values: FloatArray
    gram: FloatArray
    past: int
    rms: FloatArray
    outputs: int
    feedthrough: bool

    @property
    def largest_order(self) -> int:
        """Largest order that the data determine."""
        return int(self.basis.shape[1])

    @property
    def block_rows(self) -> int:
        """Block rows of the Gram: the past's samples and the present."""
        return self.past + 1

    @property
    def output_scale(self) -> FloatArray:
        """Factors that scale the one-step innovations of all outputs to one."""
        found = self._signals(self.largest_order)
        _, e = self._one_step(self.largest_order, found)
        variance = np.maximum(np.diag(e @ found.products @ e.T), SMALLEST_INNOVATION**2)
        return np.asarray(1.0 / (np.sqrt(variance) * self.rms[: self.outputs]))

    def rows(self, states: int) -> FloatArray:
        """Return the map from the past to the most significant states, (states, past data)."""
        return np.asarray(self.basis[:, :states].T @ self.predicted)

    def matrices(self, order: int) -> StateMatrices:
        """Return A and C of one order; see `innovation`."""
        found = self.innovation(order)
        return StateMatrices(found.A, normalised(found.C))

    def innovation(self, order: int) -> Innovation:
        """Return the innovation form of one order in the channels' own units, by two regressions.

        Raises
        ------
        IdentificationError
            If the past does not determine as many states.
        """
        m, r = self.outputs, len(self.rms) - self.outputs
        found = self._signals(order)
        coefficients, e = self._one_step(order, found)
        C, D = coefficients[:, :order], np.zeros((m, r))
        if self.feedthrough:
            D = coefficients[:, order:]
        covariance = e @ found.products @ e.T
        # An innovation of rounding does not drive the states.
        heard = np.diag(covariance) > SMALLEST_INNOVATION**2
        states, _, inputs, following = found.rows(order)
        one = np.eye(len(found.products))
        dynamics = _regression(
            found.products, one[following], np.vstack([one[states], one[inputs], e[heard]])
        )
        A, B, driven = np.split(dynamics, [order, order + r], axis=1)
        K = np.zeros((order, m))
        K[:, heard] = driven
        y_rms, u_rms = self.rms[:m], self.rms[m:]
        return Innovation(
            A,
            B / u_rms,
            C * y_rms[:, np.newaxis],
            D * y_rms[:, np.newaxis] / u_rms,
            K / y_rms,
            covariance * np.outer(y_rms, y_rms),
        )

    def innovation_covariance(self, order: int, gram: BlockGram) -> FloatArray:
        """Return the covariance of the one-step errors, (outputs, outputs), in the outputs' units.

        The data must have the same channels and as many block rows.
        """
        found = self._signals(order)
        _, e = self._one_step(order, found)
        e = e @ found.combinations / np.tile(self.rms, gram.block_rows)
        covariance = e @ gram.matrix @ e.T / gram.columns
        covariance[np.diag_indices(self.outputs)] += SMALLEST_INNOVATION**2
        y_rms = self.rms[: self.outputs]
        return np.asarray(covariance * np.outer(y_rms, y_rms))

    def _one_step(self, order: int, found: _Signals) -> tuple[FloatArray, FloatArray]:
        """Return the regression of the outputs on the states, and its remainder, by the signals."""
        states, outputs, inputs, _ = found.rows(order)
        one = np.eye(len(found.products))
        given = np.vstack([one[states], one[inputs]]) if self.feedthrough else one[states]
        coefficients = _regression(found.products, one[outputs], given)
        return coefficients, one[outputs] - coefficients @ given

    def _signals(self, order: int) -> _Signals:
        """Return the signals of the regressions of one order."""
        if not 1 <= order <= self.largest_order:
            raise IdentificationError(
                f"order must lie between 1 and {self.largest_order} for {self.past} past samples "
                f"of {self.outputs} outputs: {order}; lower it, or raise block_rows"
            )
        return self._few if order <= self._few.states else self._made(order)

    @cached_property
    def _few(self) -> _Signals:
        """Signals that serve all orders which are usually asked for."""
        return self._made(min(LARGEST_ORDER, self.largest_order))

    def _made(self, states: int) -> _Signals:
        size, channels = len(self.gram), len(self.rms)
        combinations = np.zeros((2 * states + channels, size))
        rows = self.rows(states)
        combinations[:states, :-channels] = rows
        combinations[states : 2 * states, channels:] = rows
        combinations[2 * states :, size - channels :] = np.eye(channels)
        products = combinations @ self.gram @ combinations.T
        return _Signals(combinations, products, states, self.outputs)


class _Signals(NamedTuple):
    """States, states of the next sample, outputs and inputs, as combinations of the data.

    All regressions are on few of them, so that their products replace those of the data.
    """

    combinations: FloatArray
    products: FloatArray
    states: int
    outputs: int

    def rows(self, order: int) -> tuple[slice, slice, slice, slice]:
        """Return the rows of states, outputs, inputs and next states of one order."""
        outputs = slice(2 * self.states, 2 * self.states + self.outputs)
        following = slice(self.states, self.states + order)
        return slice(0, order), outputs, slice(outputs.stop, None), following


def _regression(products: FloatArray, of: FloatArray, on: FloatArray) -> FloatArray:
    """Return the regression of combinations of signals, given as rows, on others."""
    inverse = truncated_inverse(on @ products @ on.T, equilibrated=True)
    return inverse.solve(on @ products @ of.T).T


def predictor_space(
    gram: BlockGram, *, feedthrough: bool = False, order: int | None = None
) -> PredictorSpace:
    """Return the predictor's states, from the Gram of ``p + 1`` block rows: past and present.

    With feedthrough the output may respond to the input at once (D). Under feedback the controller
    must then answer with a delay. An `order` that alone is asked for takes half of the time.

    Raises
    ------
    IdentificationError
        If there is no past.
    """
    past, m, r = gram.block_rows - 1, gram.outputs, gram.inputs
    if past < 1:
        raise IdentificationError(f"PBSID needs 2 or more block rows: {gram.block_rows}")
    channels = m + r
    scaled, rms = equilibrated(gram)
    history = past * channels
    given = list(range(history)) + (gram.input_rows(past, past + 1) if feedthrough else [])
    present = gram.output_rows(past, past + 1)
    inverse = truncated_inverse(scaled[given][:, given], equilibrated=True)
    solution = inverse.solve(scaled[given][:, present])
    responses = solution[:history].T
    explained = scaled[present][:, given] @ solution
    left = np.diag(scaled[np.ix_(present, present)] - explained).clip(min=0.0)
    weight = 1.0 / np.maximum(np.sqrt(left), SMALLEST_INNOVATION)
    future = np.zeros((past, m, history))
    for ahead in range(past):
        # Prediction of a later sample from the past alone.
        future[ahead, :, ahead * channels :] = responses[:, : history - ahead * channels]
    predicted = (weight[:, np.newaxis] * future).reshape(past * m, history)
    root = factor(scaled[:history, :history])
    left_vectors, singular_values = _directions(predicted @ root, order)
    rank = int(np.sum(singular_values > np.finfo(float).eps * singular_values[0] * history))
    basis = left_vectors[:, :rank] / np.sqrt(singular_values[:rank])
    return PredictorSpace(basis, predicted, singular_values, scaled, past, rms, m, feedthrough)


def _directions(matrix: FloatArray, count: int | None) -> tuple[FloatArray, FloatArray]:
    """Return left singular vectors and singular values, all or the leading ones.

    The eigenvalues of the square are found sooner than the singular values. Those that are small
    beside the largest lose digits there, and are found in what the others leave.
    """
    if count is None or count >= len(matrix):
        vectors, values, _ = scipy.linalg.svd(matrix, full_matrices=False)
        return vectors, values
    size = len(matrix)
    found = np.empty((size, 0))
    squares = np.empty(0)
    while len(squares) < count:
        wanted = (size - count + len(squares), size - 1)
        some, vectors = scipy.linalg.eigh(matrix @ matrix.T, subset_by_index=wanted)
        clear = some >= _CLEAR * some[-1]
        # Where all is rounding, it may be negative.
        clear[-1] = True
        found = np.hstack([found, vectors[:, clear][:, ::-1]])
        squares = np.concatenate([squares, some[clear][::-1]])
        matrix = matrix - vectors[:, clear] @ (vectors[:, clear].T @ matrix)
    return found, np.sqrt(squares.clip(min=0.0))


def past_length(gram: BlockGram, *, feedthrough: bool = False) -> int:
    """Return the number of past samples that help to predict the next: the VARX order by BIC.

    Schwarz, "Estimating the dimension of a model", Annals of Statistics 6 (1978).
    """
    scaled, _ = equilibrated(gram)
    m, r, last = gram.outputs, gram.inputs, gram.block_rows - 1
    present = gram.output_rows(last, last + 1)
    given = gram.input_rows(last, last + 1) if feedthrough else []
    at_once = len(given)
    for lag in range(1, last + 1):
        given += gram.output_rows(last - lag, last - lag + 1)
        given += gram.input_rows(last - lag, last - lag + 1)
    # With the most recent samples first, the leading part of one factor serves every length.
    normal = scaled[np.ix_(given, given)] + SMALLEST_INNOVATION**2 * np.eye(len(given))
    factor = scipy.linalg.cholesky(normal, lower=True)
    parts = scipy.linalg.solve_triangular(factor, scaled[np.ix_(given, present)], lower=True)
    left = scaled[np.ix_(present, present)] + SMALLEST_INNOVATION**2 * np.eye(m)
    left -= parts[:at_once].T @ parts[:at_once]
    criteria = []
    for lag in range(1, last + 1):
        part = parts[at_once + (lag - 1) * (m + r) : at_once + lag * (m + r)]
        left = left - part.T @ part
        likelihood = gram.columns * _log_determinant(left)
        criteria.append(likelihood + lag * m * (m + r) * np.log(gram.columns))
    return int(np.argmin(criteria)) + 1


def _log_determinant(covariance: FloatArray) -> float:
    """Return the logarithm of the determinant, with eigenvalues bounded by rounding from below."""
    values = scipy.linalg.eigvalsh(covariance)
    return float(np.sum(np.log(np.maximum(values, SMALLEST_INNOVATION**2))))

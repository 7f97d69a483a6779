"""Output least squares without eigenvectors, for an A without a full set of them.

In the real Schur form ``A = Z T Z'`` the coordinates are orthonormal, so the transformation loses
nothing, however close to each other the eigenvalues are. T is not diagonal, so each input drives a
matrix of responses, ``R' = T R + u I``, and the regressors (2-14) are ``C Z R``. R is stepped over
blocks of samples. Inside a block the regressors follow by products of matrices. Householder
reflections reduce them to one triangle per output, and nothing else is kept.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.source import Samples

_BLOCK = 32
_CHUNK = 32 * _BLOCK


class SchurRegression:
    """Linear regression of the outputs on B, the initial state and D, for one A and C.

    The parameters of one output of one record stand in the order B by input, initial state, the
    output's row of D (if `feedthrough`).

    Parameters
    ----------
    A : ndarray, (states, states)
        State matrix.
    C : ndarray, (outputs, states)
        Output matrix.
    inputs : int
        Number of inputs.
    feedthrough : bool
        Whether D is a parameter.
    """

    def __init__(self, A: FloatArray, C: FloatArray, inputs: int, *, feedthrough: bool) -> None:
        T, self.basis = scipy.linalg.schur(A, output="real")
        self.states, self.inputs, self.outputs = len(A), inputs, len(C)
        self.direct = inputs if feedthrough else 0
        powers = [np.eye(self.states)]
        for _ in range(_BLOCK):
            powers.append(T @ powers[-1])
        self._powers = np.array(powers)
        # Outputs of each state over a block: samples, outputs, states.
        self._observe = C @ self.basis @ self._powers[:_BLOCK]

    def triangles(self, record: Samples) -> FloatArray:
        """Return one record's triangles, (outputs, columns + 1, columns + 1), by QR per output.

        The last column belongs to the output itself.
        """
        n, r, m = self.states, self.inputs, self.outputs
        columns = n * (r + 1) + self.direct + 1
        triangles = np.zeros((m, columns, columns))
        start = np.zeros((n, r + 1, n))
        start[:, r] = np.eye(n)
        for u, y in record.chunks(_CHUNK):
            rows = np.empty((m, len(u), columns))
            free, start = self._responses(u, start)
            rows[:, :, : n * (r + 1)] = free
            rows[:, :, n * (r + 1) : -1] = u[:, : self.direct]
            rows[:, :, -1] = y.T
            usable = ~np.isnan(y).any(axis=1)
            for output in range(m):
                stacked = np.vstack([triangles[output], rows[output, usable]])
                triangles[output] = scipy.linalg.qr(stacked, mode="r")[0][:columns]
        return triangles

    def _responses(self, u: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (outputs, samples, states of all inputs and of the start), and the next start."""
        n, r, m = self.states, self.inputs, self.outputs
        blocks = -(-len(u) // _BLOCK)
        padded = np.zeros((blocks * _BLOCK, r))
        padded[: len(u)] = u
        inputs = padded.reshape(blocks, _BLOCK, r).transpose(0, 2, 1)
        # Effect of a block's inputs on the state at its end, (blocks, states, inputs, states).
        drive = np.tensordot(inputs, self._powers[_BLOCK - 1 :: -1], axes=1).transpose(0, 2, 1, 3)
        states = np.empty((blocks, n, r + 1, n))
        for block in range(blocks):
            states[block] = start
            start = np.tensordot(self._powers[_BLOCK], start, axes=1)
            start[:, :r] += drive[block]
        responses = np.tensordot(states, self._observe, axes=([1], [2]))
        # Now (blocks, inputs and start, states, samples, outputs).
        responses[:, :r] += self._driven(inputs)
        ordered = responses.transpose(4, 0, 3, 1, 2).reshape(m, blocks * _BLOCK, (r + 1) * n)
        return ordered[:, : len(u)], start

    def _driven(self, inputs: FloatArray) -> FloatArray:
        """Return a block's response to its own inputs, (blocks, inputs, states, samples, m)."""
        n, m = self.states, self.outputs
        pulses = np.zeros((_BLOCK, n, _BLOCK, m))
        for sample in range(_BLOCK - 1):
            # An input acts from the next sample on.
            later = self._observe[: _BLOCK - 1 - sample].transpose(2, 0, 1)
            pulses[sample, :, sample + 1 :] = later
        return np.asarray(np.tensordot(inputs, pulses, axes=1))

"""Normal equations of the output least squares in modal coordinates, without forming regressors.

In modal coordinates each of the thesis's regressors (2-14) is one scalar filter times a column of
C, so the normal matrix is the Gram of the scalar signals times, element by element, the products of
the output matrix. The signals' Gram itself is lifted: inside a block of samples every signal is a
fixed linear function of its value at the block's start and of the block's inputs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import signal

if TYPE_CHECKING:
    from flexarm_ident.arrays import ComplexArray, FloatArray

_BLOCK = 32


class Lift(NamedTuple):
    """Blocks of one record: `rows` holds per block the starts of all signals and the inputs."""

    rows: FloatArray
    length: int
    first: int


class ModalRegression:
    """Linear regression of the outputs on B, D and the initial state, for one A and C.

    The parameters of one record stand in the order B by input, D by output and input (if
    `feedthrough`), initial state.

    Parameters
    ----------
    eigenvalues : ndarray, (states,)
        Eigenvalues of A, conjugates side by side, the upper one first.
    C : ndarray, (outputs, states)
        Modal output matrix (3-3).
    inputs : int
        Number of inputs.
    weight : ndarray, (outputs,)
        Weight of each output's squared error.
    feedthrough : bool
        Whether D is a parameter.
    """

    def __init__(
        self,
        eigenvalues: ComplexArray,
        C: ComplexArray,
        inputs: int,
        weight: FloatArray,
        *,
        feedthrough: bool,
    ) -> None:
        self.eigenvalues = eigenvalues
        self.inputs = inputs
        self.weight = weight
        outputs, states = C.shape
        self.direct = outputs * inputs if feedthrough else 0
        direct = np.repeat(np.eye(outputs), inputs, axis=1)[:, : self.direct]
        self.columns = np.hstack([np.tile(C, inputs), direct, C])
        self.shared = self.columns.shape[1] - states
        self._products = (self.columns.conj().T * weight) @ self.columns
        self._upper = np.flatnonzero(eigenvalues.imag >= 0.0)
        self._expand = self._expansion()
        self._maps: dict[int, ComplexArray] = {}

    def lifts(self, u: FloatArray) -> list[Lift]:
        """Cut a record's inputs, (samples, inputs), into whole blocks and a shorter rest."""
        blocks = len(u) // _BLOCK
        lam = self.eigenvalues[self._upper]
        body = u[: blocks * _BLOCK].reshape(blocks, _BLOCK, self.inputs)
        powers = lam ** np.arange(_BLOCK - 1, -1, -1)[:, np.newaxis]
        # One row more than blocks: the state after the last whole block.
        starts = np.zeros((blocks + 1, self.inputs + 1, len(lam)), dtype=complex)
        drive = np.matmul(body.transpose(0, 2, 1), powers)
        for mode, step in enumerate(lam**_BLOCK):
            starts[1:, :-1, mode] = signal.lfilter([1.0], [1.0, -step], drive[:, :, mode], axis=0)
        starts[:, -1] = lam ** (_BLOCK * np.arange(blocks + 1)[:, np.newaxis])
        parts = np.concatenate([starts.real, starts.imag], axis=2).reshape(blocks + 1, -1)
        lifts = []
        if blocks:
            lifts.append(
                Lift(np.hstack([parts[:-1], body.reshape(blocks, _BLOCK * self.inputs)]), _BLOCK, 0)
            )
        rest = u[blocks * _BLOCK :]
        if len(rest):
            row = np.concatenate([parts[-1], rest.ravel()])[np.newaxis]
            lifts.append(Lift(row, len(rest), blocks * _BLOCK))
        return lifts

    def normal(self, lifts: list[Lift]) -> ComplexArray:
        """Return one record's normal matrix."""
        total = np.zeros(self._products.shape, dtype=complex)
        for lift in lifts:
            gram = lift.rows.T @ lift.rows
            for regressors in self._map(lift.length):
                total += np.conj(regressors @ gram @ regressors.conj().T)
        return np.asarray(self._products * total)

    def right(self, lifts: list[Lift], y: FloatArray) -> ComplexArray:
        """Return one record's right-hand side for the outputs `y`, (samples, outputs)."""
        total = np.zeros(self.columns.T.shape, dtype=complex)
        for lift in lifts:
            blocks = y[lift.first : lift.first + len(lift.rows) * lift.length]
            cross = lift.rows.T @ blocks.reshape(len(lift.rows), -1)
            steps = cross.reshape(-1, lift.length, y.shape[1]).transpose(1, 0, 2)
            total += np.matmul(self._map(lift.length), steps).sum(axis=0)
        return np.asarray(np.conj(self.columns.T * total) @ self.weight)

    def predict(self, lifts: list[Lift], parameters: ComplexArray) -> FloatArray:
        """Return the outputs, (samples, outputs), for one record's parameters."""
        weighted = (self.columns * parameters).T
        outputs = weighted.shape[1]
        y = np.empty((sum(len(lift.rows) * lift.length for lift in lifts), outputs))
        for lift in lifts:
            # Real, because conjugate modes come in pairs.
            response = np.matmul(self._map(lift.length).transpose(0, 2, 1), weighted).real
            flat = response.transpose(1, 0, 2).reshape(response.shape[1], -1)
            last = lift.first + len(lift.rows) * lift.length
            np.matmul(lift.rows, flat, out=y[lift.first : last].reshape(len(lift.rows), -1))
        return y

    def _expansion(self) -> ComplexArray:
        """Return the map from real and imaginary parts of the upper modes to all modes."""
        count = len(self._upper)
        expand = np.zeros((len(self.eigenvalues), 2 * count), dtype=complex)
        for column, mode in enumerate(self._upper):
            expand[mode, column], expand[mode, count + column] = 1.0, 1.0j
            if self.eigenvalues[mode].imag > 0.0:
                expand[mode + 1, column], expand[mode + 1, count + column] = 1.0, -1.0j
        return expand

    def _map(self, length: int) -> ComplexArray:
        """Return the map from a lift's row to all signals, for each sample of its block."""
        if length not in self._maps:
            self._maps[length] = self._build_map(length)
        return self._maps[length]

    def _build_map(self, length: int) -> ComplexArray:
        n, r, parts = len(self.eigenvalues), self.inputs, self._expand.shape[1]
        inputs_at = (r + 1) * parts
        signals = np.zeros((length, self.shared + n, inputs_at + length * r), dtype=complex)
        powers = self.eigenvalues ** np.arange(length)[:, np.newaxis]
        evolved = powers[:, :, np.newaxis] * self._expand
        firsts = [*range(0, r * n, n), self.shared]
        for source, first in enumerate(firsts):
            at = slice(source * parts, (source + 1) * parts)
            signals[:, first : first + n, at] = evolved
        for t in range(length):
            for j in range(r):
                past = inputs_at + np.arange(t) * r + j
                signals[t, j * n : (j + 1) * n, past] = powers[:t][::-1]
            now = inputs_at + t * r + np.tile(np.arange(r), self.direct // max(r, 1))
            signals[t, r * n + np.arange(self.direct), now] = 1.0
        return signals

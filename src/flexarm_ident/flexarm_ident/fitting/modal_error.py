"""Errors of a free simulation over the parameters of a model in real modal form.

Every derivative is the response of the same model to another input. The errors of each output pass
a filter before they are squared: a weight, or the inverse of the filter that coloured the noise.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_ident.fitting.levenberg_marquardt import Normal
from flexarm_ident.fitting.modal_parameters import ModalParameters
from flexarm_ident.models.state_space import BlockSimulation

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.records.iodata import IoData

_CHUNK = 2048
_HALF = 0.5


class ModalError(ModalParameters):
    """Cost and normal equations over modal parameters: A, B, C and the initial states; D stays.

    No eigenvalue leaves the unit circle, but for one that begins outside.

    Parameters
    ----------
    model : control.StateSpace
        Discrete start, with a basis of eigenvectors.
    records : sequence of IoData
        Records.
    filters : sequence of ndarray, (taps,)
        Filter of each output's errors. A filter that reaches a row without a working sensor gives
        no error.
    """

    def __init__(
        self,
        model: control.StateSpace,
        records: Sequence[IoData],
        filters: Sequence[FloatArray],
    ) -> None:
        super().__init__(model)
        self._records = records
        self.filters = filters

    @property
    def filters(self) -> Sequence[FloatArray]:
        """Filter of each output's errors."""
        return self._filters

    @filters.setter
    def filters(self, filters: Sequence[FloatArray]) -> None:
        self._filters = filters
        self._known = [[_known(each, len(taps)) for taps in filters] for each in self._records]

    def unpack(self, theta: FloatArray) -> tuple[control.StateSpace, tuple[FloatArray, ...]]:
        """Return model and initial states, in the coordinates of the start."""
        return self.model(theta), self.ends(theta)

    def cost(self, theta: FloatArray) -> float:
        """Return the sum of squares."""
        A, B, C, starts = self.split(theta)
        total = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for record, start, known in zip(self._records, starts, self._known, strict=True):
                y = BlockSimulation(A, B, C, self._start.D, start).advance(record.u)
                for e, taps, rows in zip((y - record.y).T, self._filters, known, strict=True):
                    total += float(np.sum(scipy.signal.lfilter(taps, [1.0], e)[rows] ** 2))
        return total

    def normal(self, theta: FloatArray) -> Normal:
        """Return cost, gradient and the product of the Jacobian with itself."""
        A, B, C, starts = self.split(theta)
        n, m = self.n, self.m
        moving = self.dynamic + n
        cost, gradient = 0.0, np.zeros(len(theta))
        matrix = np.zeros((len(theta), len(theta)))
        for number, record in enumerate(self._records):
            runs = [_BlockRun(A, B, starts[number], group) for group in self.groups]
            memories = [np.zeros((len(taps) - 1, moving + n + 1)) for taps in self._filters]
            for first in range(0, len(record), _CHUNK):
                rows = slice(first, first + _CHUNK)
                u = record.u[rows]
                states, slopes = np.empty((len(u), n)), np.zeros((len(u), m, moving))
                for run in runs:
                    states[:, run.states], parts = run.advance(u)
                    slopes[:, :, run.columns] = np.matmul(C[:, run.states], parts)
                e = states @ C.T + u @ self._start.D.T - record.y[rows]
                for output, taps in enumerate(self._filters):
                    block = np.column_stack([slopes[:, output], states, e[:, output]])
                    passed, memories[output] = scipy.signal.lfilter(
                        taps, [1.0], block, axis=0, zi=memories[output]
                    )
                    passed = passed[self._known[number][output][rows]]
                    product = passed.T @ passed
                    place = self.columns(output, number)
                    cost += float(product[-1, -1])
                    gradient[place] += product[:-1, -1]
                    matrix[np.ix_(place, place)] += product[:-1, :-1]
        return Normal(cost, gradient, matrix)


class _BlockRun:
    """States of one mode and their derivatives, chunk by chunk.

    They depend on the mode's own parameters alone: the entries of A, the rows of B and the initial
    state.
    """

    def __init__(
        self, A: FloatArray, B: FloatArray, start: FloatArray, group: tuple[int, ...]
    ) -> None:
        n, r = B.shape
        self.states = list(group)
        self._A, self._B = A[np.ix_(group, group)], np.ascontiguousarray(B[self.states])
        size, inputs = len(group), [n + i * r + j for i in group for j in range(r)]
        self.columns = [*group, *inputs, *(n + n * r + i for i in group)]
        count = len(self.columns)
        self._d_A, self._d_B = np.zeros((size, size, count)), np.zeros((size, r, count))
        self._d_A[..., 0] = np.eye(size)
        if size > 1:
            self._d_A[..., 1] = [[0.0, 1.0], [-1.0, 0.0]]
        for entry in range(size * r):
            self._d_B[entry // r, entry % r, size + entry] = 1.0
        self._x, self._d_x = start[self.states], np.zeros((size, count))
        self._d_x[:, -size:] = np.eye(size)

    def advance(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return states and derivatives, (samples, states, columns), for the next inputs."""
        from flexarm_ident.models.stick_slip import run_sensitivity  # noqa: PLC0415 - numba loads slowly

        r, count = self._B.shape[1], len(self.columns)
        # One sample more than the chunk: where the next one starts.
        longer = np.vstack([u, np.zeros((1, r))])
        still, steady = np.zeros((r, len(self._x))), np.zeros((r, count))
        smooth, constant = np.zeros((r, 4)), np.zeros((r, 4, count))
        x, d_x = run_sensitivity(
            *(self._A, self._B, still, smooth, longer, longer, self._x),
            *(self._d_A, self._d_B, constant, steady, self._d_x, np.arange(len(self._x))),
        )
        self._x, self._d_x = x[-1].copy(), d_x[-1].copy()
        return x[:-1], d_x[:-1]


def _known(record: IoData, taps: int) -> BoolArray:
    """Return the rows from which a filter reaches no row that cannot be used."""
    reached = np.convolve(~record.usable, np.ones(taps))[: len(record)]
    return np.asarray(reached < _HALF)

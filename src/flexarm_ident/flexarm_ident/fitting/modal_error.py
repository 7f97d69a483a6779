"""Errors of a free simulation over the parameters of a model in real modal form.

A has two parameters per pair there instead of a full matrix, and every derivative is the response
of the same model to another input. The errors of each output pass a filter before they are squared:
a weight, or the inverse of the filter that coloured the noise.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_ident.fitting.levenberg_marquardt import Normal, minimise
from flexarm_ident.models.free_run import BlockSimulation
from flexarm_ident.models.modes import modal_form
from flexarm_ident.models.state_space import INTEGRATOR_RADIUS, with_matrices

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.fitting.levenberg_marquardt import Minimum
    from flexarm_ident.records.iodata import IoData

_CHUNK = 2048
_HALF = 0.5


class ModalError:
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
        form = modal_form(model)
        self._model, self._records, self._groups = model, records, form.groups
        # Columns of a pair: real and imaginary part of its vector.
        self._basis = np.empty((model.nstates, model.nstates))
        for group in form.groups:
            vector = form.vectors[:, group[0]]
            self._basis[:, group[0]] = vector.real
            if len(group) > 1:
                self._basis[:, group[1]] = vector.imag
        self._largest = max(INTEGRATOR_RADIUS, float(np.abs(form.eigenvalues).max(initial=0.0)))
        self._filters = filters
        self._known = [[_known(record, len(taps)) for taps in filters] for record in records]
        self._n, self._r, self._m = model.nstates, model.ninputs, model.noutputs

    @property
    def groups(self) -> list[tuple[int, ...]]:
        """Parameters of A by mode: real part, and imaginary part of a pair."""
        return self._groups

    def pack(self, x0: Sequence[FloatArray]) -> FloatArray:
        """Return the parameters of the start."""
        inverse = np.linalg.inv(self._basis)
        A = inverse @ self._model.A @ self._basis
        entries = []
        for group in self._groups:
            entries.append(A[group[0], group[0]])
            if len(group) > 1:
                entries.append(A[group[0], group[1]])
        B, C = inverse @ self._model.B, self._model.C @ self._basis
        return np.concatenate([entries, B.ravel(), C.ravel(), *(inverse @ x for x in x0)])

    def unpack(self, theta: FloatArray) -> tuple[control.StateSpace, tuple[FloatArray, ...]]:
        """Return model and initial states, in the coordinates of the start."""
        A, B, C, starts = self._split(theta)
        T, inverse = self._basis, np.linalg.inv(self._basis)
        model = with_matrices(self._model, A=T @ A @ inverse, B=T @ B, C=C @ inverse)
        return model, tuple(T @ start for start in starts)

    def without(
        self, theta: FloatArray, group: tuple[int, ...]
    ) -> tuple[control.StateSpace, tuple[FloatArray, ...]]:
        """Return model and initial states with one mode left out, in modal coordinates."""
        A, B, C, starts = self._split(theta)
        kept = np.delete(np.arange(self._n), group)
        model = with_matrices(self._model, A=A[np.ix_(kept, kept)], B=B[kept], C=C[:, kept])
        return model, tuple(start[kept] for start in starts)

    def powers(self, theta: FloatArray) -> FloatArray:
        """Return the sum of squares that each mode alone gives behind the filters, (modes,)."""
        A, B, C, starts = self._split(theta)
        powers = np.zeros(len(self._groups))
        for mode, group in enumerate(map(list, self._groups)):
            own = (A[np.ix_(group, group)], B[group], C[:, group], np.zeros_like(self._model.D))
            for record, start, known in zip(self._records, starts, self._known, strict=True):
                y = BlockSimulation(*own, start[group]).advance(record.u)
                for alone, taps, rows in zip(y.T, self._filters, known, strict=True):
                    passed = scipy.signal.lfilter(taps, [1.0], alone)
                    powers[mode] += float(np.sum(passed[rows] ** 2))
        return powers

    def minimised(
        self, x0: Sequence[FloatArray], *, iterations: int, on_step: Callable[[], None]
    ) -> Minimum:
        """Return the minimum that is found from the start, see `minimise`."""
        return minimise(
            self.pack(x0),
            self.cost,
            self.normal,
            allowed=self.allowed,
            iterations=iterations,
            on_step=on_step,
        )

    def allowed(self, theta: FloatArray) -> FloatArray:
        """Return parameters whose eigenvalues are no larger than allowed, the others unchanged."""
        allowed, at = theta.copy(), 0
        for group in self._groups:
            entries = slice(at, at + len(group))
            radius = float(np.linalg.norm(theta[entries]))
            if radius > self._largest:
                allowed[entries] *= self._largest / radius
            at += len(group)
        return allowed

    def cost(self, theta: FloatArray) -> float:
        """Return the sum of squares."""
        A, B, C, starts = self._split(theta)
        total = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for record, start, known in zip(self._records, starts, self._known, strict=True):
                y = BlockSimulation(A, B, C, self._model.D, start).advance(record.u)
                for e, taps, rows in zip((y - record.y).T, self._filters, known, strict=True):
                    total += float(np.sum(scipy.signal.lfilter(taps, [1.0], e)[rows] ** 2))
        return total

    def normal(self, theta: FloatArray) -> Normal:
        """Return cost, gradient and the product of the Jacobian with itself."""
        A, B, C, starts = self._split(theta)
        n, r, m = self._n, self._r, self._m
        dynamic, moving = n + n * r, n + n * r + n
        cost, gradient = 0.0, np.zeros(len(theta))
        matrix = np.zeros((len(theta), len(theta)))
        for number, record in enumerate(self._records):
            own = dynamic + n * m + number * n + np.arange(n)
            runs = [_BlockRun(A, B, starts[number], group) for group in self._groups]
            memories = [np.zeros((len(taps) - 1, moving + n + 1)) for taps in self._filters]
            for first in range(0, len(record), _CHUNK):
                rows = slice(first, first + _CHUNK)
                u = record.u[rows]
                states, slopes = np.empty((len(u), n)), np.zeros((len(u), m, moving))
                for run in runs:
                    states[:, run.states], parts = run.advance(u)
                    slopes[:, :, run.columns] = np.matmul(C[:, run.states], parts)
                e = states @ C.T + u @ self._model.D.T - record.y[rows]
                for output, taps in enumerate(self._filters):
                    block = np.column_stack([slopes[:, output], states, e[:, output]])
                    passed, memories[output] = scipy.signal.lfilter(
                        taps, [1.0], block, axis=0, zi=memories[output]
                    )
                    passed = passed[self._known[number][output][rows]]
                    product = passed.T @ passed
                    place = np.r_[:dynamic, own, dynamic + output * n + np.arange(n)]
                    cost += float(product[-1, -1])
                    gradient[place] += product[:-1, -1]
                    matrix[np.ix_(place, place)] += product[:-1, :-1]
        return Normal(cost, gradient, matrix)

    def _split(
        self, theta: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, tuple[FloatArray, ...]]:
        n, r, m = self._n, self._r, self._m
        A, at = np.zeros((n, n)), 0
        for group in self._groups:
            i = group[0]
            A[i, i] = theta[at]
            if len(group) > 1:
                j = group[1]
                A[i, j], A[j, i], A[j, j] = theta[at + 1], -theta[at + 1], theta[at]
            at += len(group)
        B = theta[n : n + n * r].reshape(n, r)
        C = theta[n + n * r : n + n * r + n * m].reshape(m, n)
        starts = theta[n + n * r + n * m :].reshape(-1, n)
        return A, B.copy(), C.copy(), tuple(start.copy() for start in starts)


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
            *(self._d_A, self._d_B, constant, steady, self._d_x),
        )
        self._x, self._d_x = x[-1].copy(), d_x[-1].copy()
        return x[:-1], d_x[:-1]


def _known(record: IoData, taps: int) -> BoolArray:
    """Return the rows from which a filter reaches no row that cannot be used."""
    reached = np.convolve(~record.usable, np.ones(taps))[: len(record)]
    return np.asarray(reached < _HALF)

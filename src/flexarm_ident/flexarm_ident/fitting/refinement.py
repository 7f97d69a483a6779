"""Refinement of a whole model by its simulation error, from a subspace start.

Subspace methods minimise a projection, and the output fit changes only B and the initial states.
Here A, B, C and the initial states change together, by damped Gauss-Newton steps, to lower the sum
of the squared relative errors (2-25) of the free simulation. The model has real modal form, in
which A has two parameters per pair instead of a full matrix, and every derivative is the response
of the same model to another input.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.fitting.levenberg_marquardt import Normal, minimise
from flexarm_ident.models.free_run import BlockSimulation, simulate
from flexarm_ident.models.modes import modal_form
from flexarm_ident.models.state_space import with_matrices
from flexarm_ident.records.iodata import as_records

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import FloatArray, Progress
    from flexarm_ident.records.iodata import IoData

_CHUNK = 2048
_DEFECTIVE_CONDITION = 1e8
_ITERATIONS = 30


@dataclass(frozen=True, eq=False)
class Refinement:
    """Refined model, or the start when no better one was found.

    Attributes
    ----------
    model : control.StateSpace
        The model.
    x0 : tuple of ndarray, (states,)
        Initial state of each record.
    error : ndarray, (outputs,)
        Relative simulation error of each output over the records (2-25).
    start_error : ndarray, (outputs,)
        The same of the start.
    """

    model: control.StateSpace
    x0: tuple[FloatArray, ...]
    error: FloatArray
    start_error: FloatArray


def refine_model(
    model: control.StateSpace,
    x0: Sequence[FloatArray],
    data: IoData | Sequence[IoData],
    *,
    iterations: int = _ITERATIONS,
    progress: Progress | None = None,
) -> Refinement:
    """Refine A, B, C and the initial states by simulation error; D stays.

    Parameters
    ----------
    model : control.StateSpace
        Discrete start.
    x0 : sequence of ndarray, (states,)
        Initial state of each record.
    data : IoData or sequence of IoData
        Records.
    iterations : int
        Largest number of steps.
    progress : callable, optional
        Called with the stage "refinement" and the completed part.

    Returns
    -------
    Refinement
        A model whose sum of squared relative errors is not above that of the start. Its largest
        eigenvalue is not beyond both the start's and the unit circle.
    """
    records = as_records(data)
    before = _errors(model, x0, records)
    unchanged = Refinement(model, tuple(x0), before, before)
    form = modal_form(model)
    if np.linalg.cond(form.vectors) > _DEFECTIVE_CONDITION or not np.isfinite(before).all():
        return unchanged
    problem = _Modal(model, records)
    steps = 0

    def normal(theta: FloatArray) -> Normal:
        nonlocal steps
        if progress is not None:
            progress("refinement", min(1.0, steps / iterations))
        steps += 1
        return problem.normal(theta)

    found = minimise(problem.pack(x0), problem.cost, normal, iterations=iterations)
    if not np.isfinite(found.cost):
        return unchanged
    refined, starts = problem.unpack(found.theta)
    after = _errors(refined, starts, records)
    # An independent simulation decides, so that rounding cannot make the model worse.
    if not np.sum(after**2) < np.sum(before**2):
        return unchanged
    return Refinement(refined, starts, after, before)


class _Modal:
    """Cost and normal equations over modal parameters: A, B, C and the initial states."""

    def __init__(self, model: control.StateSpace, records: Sequence[IoData]) -> None:
        form = modal_form(model)
        self._model, self._records, self._groups = model, records, form.groups
        # Columns of a pair: real and imaginary part of its vector.
        self._basis = np.empty((model.nstates, model.nstates))
        for group in form.groups:
            vector = form.vectors[:, group[0]]
            self._basis[:, group[0]] = vector.real
            if len(group) > 1:
                self._basis[:, group[1]] = vector.imag
        self._largest = max(1.0, float(np.abs(form.eigenvalues).max(initial=0.0)))
        power = np.sum([np.nansum(record.y_usable**2, axis=0) for record in records], axis=0)
        self._weight = np.sqrt(np.divide(1.0, power, out=np.zeros_like(power), where=power > 0.0))
        self._n, self._r, self._m = model.nstates, model.ninputs, model.noutputs

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

    def cost(self, theta: FloatArray) -> float:
        A, B, C, starts = self._split(theta)
        if np.abs(np.linalg.eigvals(A)).max(initial=0.0) > self._largest:
            return np.inf
        total = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for record, start in zip(self._records, starts, strict=True):
                missed = self._weight * (
                    BlockSimulation(A, B, C, self._model.D, start).advance(record.u) - record.y
                )
                total += float(np.sum(missed[record.usable] ** 2))
        return total

    def normal(self, theta: FloatArray) -> Normal:
        A, B, C, starts = self._split(theta)
        n, r, m = self._n, self._r, self._m
        dynamic, moving = n + n * r, n + n * r + n
        cost, gradient = 0.0, np.zeros(len(theta))
        matrix = np.zeros((len(theta), len(theta)))
        for number, (record, start) in enumerate(zip(self._records, starts, strict=True)):
            own = dynamic + n * m + number * n + np.arange(n)
            place = np.concatenate([np.arange(dynamic), own, dynamic + np.arange(n * m)])
            runs = [_BlockRun(A, B, start, group) for group in self._groups]
            for first in range(0, len(record), _CHUNK):
                u = record.u[first : first + _CHUNK]
                states = np.empty((len(u), n))
                jacobian = np.zeros((len(u), m, moving + m * n))
                for run in runs:
                    states[:, run.states], slopes = run.advance(u)
                    jacobian[:, :, run.columns] = np.matmul(C[:, run.states], slopes)
                for output in range(m):
                    columns = slice(moving + output * n, moving + (output + 1) * n)
                    jacobian[:, output, columns] = states
                y = states @ C.T + u @ self._model.D.T
                rows = slice(first, first + _CHUNK)
                weight = np.outer(record.usable[rows], self._weight)
                e = (weight * (y - record.y[rows])).ravel()
                jacobian *= weight[:, :, np.newaxis]
                flat = jacobian.reshape(len(e), -1)
                cost += float(e @ e)
                gradient[place] += flat.T @ e
                matrix[np.ix_(place, place)] += flat.T @ flat
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
        self._d_A, self._d_B = np.zeros((count, size, size)), np.zeros((count, size, r))
        self._d_A[0] = np.eye(size)
        if size > 1:
            self._d_A[1] = [[0.0, 1.0], [-1.0, 0.0]]
        for entry in range(size * r):
            self._d_B[size + entry, entry // r, entry % r] = 1.0
        self._x, self._d_x = start[self.states], np.zeros((size, count))
        self._d_x[:, -size:] = np.eye(size)

    def advance(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return states and derivatives, (samples, states, columns), for the next inputs."""
        from flexarm_ident.models.stick_slip import run_sensitivity  # noqa: PLC0415 - numba loads slowly

        r, count = self._B.shape[1], len(self.columns)
        # One sample more than the chunk: where the next one starts.
        longer = np.vstack([u, np.zeros((1, r))])
        still, steady = np.zeros((r, len(self._x))), np.zeros((r, count))
        x, d_x = run_sensitivity(
            *(self._A, self._B, still, np.zeros(r), longer, self._x),
            *(self._d_A, self._d_B, steady, steady, self._d_x),
        )
        self._x, self._d_x = x[-1].copy(), d_x[-1].copy()
        return x[:-1], d_x[:-1]


def _errors(
    model: control.StateSpace, x0: Sequence[FloatArray], records: Sequence[IoData]
) -> FloatArray:
    missed, total = np.zeros(model.noutputs), np.zeros(model.noutputs)
    with np.errstate(over="ignore", invalid="ignore"):
        for record, start in zip(records, x0, strict=True):
            y = record.y_measured
            missed += np.nansum((simulate(model, record.u, start) - y) ** 2, axis=0)
            total += np.nansum(y**2, axis=0)
    return np.sqrt(np.divide(missed, total, out=np.zeros_like(missed), where=total > 0.0))

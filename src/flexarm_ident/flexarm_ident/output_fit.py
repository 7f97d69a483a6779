"""B, D and x0 by output least squares (2-13 .. 2-17, 3-11 .. 3-18), and C (3-19 .. 3-21).

Given A and C the outputs are linear in B, D and the initial states. Each output is weighted by the
inverse of its RMS, so that its unit does not matter: what is minimised is the sum of the squared
relative errors (2-25).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import linalg

from flexarm_ident.errors import IdentificationError
from flexarm_ident.modal_regression import ModalRegression
from flexarm_ident.simulation import simulate, simulate_states

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control

    from flexarm_ident.arrays import AnyArray, ComplexArray, FloatArray
    from flexarm_ident.iodata import IoData

_WELL_CONDITIONED = 100.0
_ROWS_AT_ONCE = 32
_DEFECTIVE_CONDITION = 1e8
_LARGEST_GROWTH = 100.0


@dataclass(frozen=True)
class OutputFit:
    """Solution of the output least squares.

    Attributes
    ----------
    B : ndarray, (states, inputs)
        Input matrix.
    D : ndarray, (outputs, inputs)
        Feedthrough; zero unless it was asked for.
    x0 : tuple of ndarray, (states,)
        Initial state of each record.
    error : ndarray, (outputs,)
        Relative simulation error of each output over all records (2-25).
    rank : int
        Numerical rank of the regression.
    condition : float
        Condition number of the regressors, each scaled to unit length.
    """

    B: FloatArray
    D: FloatArray
    x0: tuple[FloatArray, ...]
    error: FloatArray
    rank: int
    condition: float


def fit_inputs(
    A: FloatArray, C: FloatArray, records: Sequence[IoData], *, feedthrough: bool = False
) -> OutputFit:
    """Fit B, the initial states and, on request, D to the outputs (2-17), (3-17).

    Parameters
    ----------
    A : ndarray, (states, states)
        State matrix, best without eigenvalues outside the unit circle.
    C : ndarray, (outputs, states)
        Output matrix.
    records : sequence of IoData
        Records of the same rig; each has its own initial state.
    feedthrough : bool
        Fit D as well. The rig has none: a command acts after the sample it answers.

    Returns
    -------
    OutputFit
        The matrices, the initial states and how well they are determined.

    Raises
    ------
    IdentificationError
        If A is so unstable that its response overflows.
    """
    inputs, outputs = [record.u for record in records], [record.y for record in records]
    return _fit(A, C, inputs, outputs, feedthrough=feedthrough)


def fit_initial_states(
    model: control.StateSpace, records: Sequence[IoData]
) -> tuple[FloatArray, ...]:
    """Fit each record's initial state to its outputs, given the whole model.

    Parameters
    ----------
    model : control.StateSpace
        Discrete model.
    records : sequence of IoData
        Records of the same rig.

    Returns
    -------
    tuple of ndarray, (states,)
        Initial states.
    """
    inputs = [record.u[:, :0] for record in records]
    missed = [record.y - simulate(model, record.u) for record in records]
    return _fit(model.A, model.C, inputs, missed, feedthrough=False).x0


def fit_outputs(
    model: control.StateSpace, x0: Sequence[FloatArray], records: Sequence[IoData]
) -> FloatArray:
    """Fit C to the outputs, given A, B, D and the initial states (3-19 .. 3-21).

    Each output has its own row of C and its own regression, so weights do not matter.

    Parameters
    ----------
    model : control.StateSpace
        Discrete model, whose C is not used.
    x0 : sequence of ndarray, (states,)
        Initial state of each record.
    records : sequence of IoData
        Records of the same rig.

    Returns
    -------
    ndarray, (outputs, states)
        C.
    """
    states = [
        simulate_states(model.A, model.B, record.u, start)
        for record, start in zip(records, x0, strict=True)
    ]
    outputs = [record.y - record.u @ model.D.T for record in records]
    C = np.linalg.lstsq(np.vstack(states), np.vstack(outputs), rcond=None)[0].T
    return np.asarray(C, dtype=np.float64)


def _fit(
    A: FloatArray,
    C: FloatArray,
    inputs: Sequence[FloatArray],
    outputs: Sequence[FloatArray],
    *,
    feedthrough: bool,
) -> OutputFit:
    eigenvalues, vectors = np.linalg.eig(A)
    longest = max(len(u) for u in inputs)
    largest = float(np.abs(eigenvalues).max(initial=0.0))
    if largest > 1.0 and longest * np.log(largest) > _LARGEST_GROWTH:
        raise IdentificationError(
            f"an eigenvalue of magnitude {largest:.4f} grows beyond all bounds in {longest} "
            "samples: stabilise the model first"
        )
    weight = _output_weight(outputs)
    if np.linalg.cond(vectors) > _DEFECTIVE_CONDITION:
        return _fit_stepwise(A, C, inputs, outputs, weight, feedthrough=feedthrough)
    regression = ModalRegression(
        eigenvalues.astype(complex),
        (C @ vectors).astype(complex),
        inputs[0].shape[1],
        weight,
        feedthrough=feedthrough,
    )
    return _fit_modal(regression, vectors, inputs, outputs)


def _output_weight(outputs: Sequence[FloatArray]) -> FloatArray:
    power = np.mean([np.einsum("ki,ki->i", y, y) / len(y) for y in outputs], axis=0)
    return np.asarray(np.divide(1.0, power, out=np.ones_like(power), where=power > 0.0))


def _relative_error(residuals: Sequence[FloatArray], outputs: Sequence[FloatArray]) -> FloatArray:
    missed = np.sum([np.einsum("ki,ki->i", e, e) for e in residuals], axis=0)
    total = np.sum([np.einsum("ki,ki->i", y, y) for y in outputs], axis=0)
    part = np.divide(missed, total, out=np.zeros_like(missed), where=total > 0.0)
    return np.asarray(np.sqrt(part))


def _fit_modal(
    regression: ModalRegression,
    vectors: ComplexArray,
    inputs: Sequence[FloatArray],
    outputs: Sequence[FloatArray],
) -> OutputFit:
    states, shared = len(vectors), regression.shared
    lifts = [regression.lifts(u) for u in inputs]
    # B and D once, then an initial state per record.
    places = [
        np.r_[:shared, shared + number * states + np.arange(states)]
        for number in range(len(inputs))
    ]
    size = shared + len(inputs) * states
    normal = np.zeros((size, size), dtype=complex)
    for place, pieces in zip(places, lifts, strict=True):
        normal[np.ix_(place, place)] += regression.normal(pieces)
    inverse, rank, condition = _pseudo_inverse(normal)
    parameters = np.zeros(size, dtype=complex)
    residuals = list(outputs)
    # Normal equations square the condition; solving again for the residual gives the digits back.
    for _ in range(1 if condition < _WELL_CONDITIONED else 2):
        right = np.zeros(size, dtype=complex)
        for place, pieces, residual in zip(places, lifts, residuals, strict=True):
            right[place] += regression.right(pieces, residual)
        parameters += inverse(right)
        for number, (pieces, place) in enumerate(zip(lifts, places, strict=True)):
            residuals[number] = outputs[number] - regression.predict(pieces, parameters[place])
    B, D, x0 = _unpacked(parameters, outputs[0].shape[1], inputs[0].shape[1], states, shared)
    return OutputFit(
        (vectors @ B).real,
        D.real,
        tuple((vectors @ start).real for start in x0),
        _relative_error(residuals, outputs),
        rank,
        condition,
    )


def _pseudo_inverse(
    normal: ComplexArray,
) -> tuple[Callable[[ComplexArray], ComplexArray], int, float]:
    scale = np.sqrt(np.diag(normal).real)
    scale[scale == 0.0] = 1.0
    values, vectors = linalg.eigh(normal / np.outer(scale, scale))
    kept = values > len(values) * np.finfo(float).eps * values[-1]
    basis = vectors[:, kept]

    def solve(right: ComplexArray) -> ComplexArray:
        return np.asarray(basis @ (basis.conj().T @ (right / scale) / values[kept]) / scale)

    condition = np.sqrt(values[-1] / max(values[0], np.finfo(float).eps * values[-1]))
    return solve, int(kept.sum()), float(condition)


def _unpacked(
    parameters: AnyArray, outputs: int, inputs: int, states: int, shared: int
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Return B, D and the initial states, a row per record."""
    B = parameters[: inputs * states].reshape(inputs, states).T
    D = np.zeros((outputs, inputs), dtype=parameters.dtype)
    if shared > inputs * states:
        D = parameters[inputs * states : shared].reshape(outputs, inputs)
    return B, D, parameters[shared:].reshape(-1, states)


def _fit_stepwise(
    A: FloatArray,
    C: FloatArray,
    inputs: Sequence[FloatArray],
    outputs: Sequence[FloatArray],
    weight: FloatArray,
    *,
    feedthrough: bool,
) -> OutputFit:
    """Fit without eigenvectors, for an A that has no full set: (2-14) step by step, then QR."""
    (m, n), r = C.shape, inputs[0].shape[1]
    shared = r * n + (m * r if feedthrough else 0)
    size = shared + len(inputs) * n
    triangle = np.zeros((0, size + 1))
    for number, (u, y) in enumerate(zip(inputs, outputs, strict=True)):
        own = slice(shared + number * n, shared + (number + 1) * n)
        response, free = np.zeros((r, n, n)), np.eye(n)
        for first in range(0, len(u), _ROWS_AT_ONCE):
            u_rows = u[first : first + _ROWS_AT_ONCE]
            rows = np.zeros((len(u_rows), m, size + 1))
            for k, u_k in enumerate(u_rows):
                rows[k, :, : r * n] = (C @ response).transpose(1, 0, 2).reshape(m, r * n)
                rows[k, :, own] = C @ free
                response = A @ response + u_k[:, np.newaxis, np.newaxis] * np.eye(n)
                free = A @ free
            if feedthrough:
                rows[:, :, r * n : shared] = np.kron(np.eye(m), u_rows[:, np.newaxis])
            rows[:, :, -1] = y[first : first + _ROWS_AT_ONCE]
            rows *= np.sqrt(weight)[:, np.newaxis]
            stacked = np.vstack([triangle, rows.reshape(-1, size + 1)])
            triangle = linalg.qr(stacked, mode="r")[0][: size + 1]
    length = np.linalg.norm(triangle[:, :-1], axis=0)
    length[length == 0.0] = 1.0
    solution, _, rank, values = np.linalg.lstsq(triangle[:, :-1] / length, triangle[:, -1])
    B, D, x0 = _unpacked(solution / length, m, r, n, shared)
    residuals = [
        y - simulate_states(A, B, u, start) @ C.T - u @ D.T
        for u, y, start in zip(inputs, outputs, x0, strict=True)
    ]
    condition = float(values[0] / max(values[-1], np.finfo(float).eps * values[0]))
    return OutputFit(B, D, tuple(x0), _relative_error(residuals, outputs), int(rank), condition)

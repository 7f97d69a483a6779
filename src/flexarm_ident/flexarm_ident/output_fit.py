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
from flexarm_ident.simulation import BlockSimulation, simulate, simulate_states

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import control

    from flexarm_ident.arrays import AnyArray, ComplexArray, FloatArray
    from flexarm_ident.iodata import IoData
    from flexarm_ident.modal_regression import Missed, Products
    from flexarm_ident.source import Samples, Source

# Six of sixteen digits are lost by squaring it.
_WELL_CONDITIONED = 1e3
_ROWS_AT_ONCE = 32
_CHUNK = 16384
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
    A: FloatArray, C: FloatArray, records: Sequence[Source], *, feedthrough: bool = False
) -> OutputFit:
    """Fit B, the initial states and, on request, D to the outputs (2-17), (3-17).

    Parameters
    ----------
    A : ndarray, (states, states)
        State matrix, best without eigenvalues outside the unit circle.
    C : ndarray, (outputs, states)
        Output matrix.
    records : sequence of Source
        Records of the same rig, in memory or read in chunks; each has its own initial state.
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
    return _fit(A, C, len(records[0].inputs), records, feedthrough=feedthrough)


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
    missed = [_FreeResponse(record.y - simulate(model, record.u)) for record in records]
    return _fit(model.A, model.C, 0, missed, feedthrough=False).x0


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


@dataclass(frozen=True)
class _FreeResponse:
    """Samples without an input."""

    y: FloatArray

    def __len__(self) -> int:
        return len(self.y)

    def chunks(self, samples: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        for first in range(0, len(self), samples):
            y = self.y[first : first + samples]
            yield y[:, :0], y


def _fit(
    A: FloatArray, C: FloatArray, inputs: int, records: Sequence[Samples], *, feedthrough: bool
) -> OutputFit:
    eigenvalues, vectors = np.linalg.eig(A)
    longest = max(len(record) for record in records)
    largest = float(np.abs(eigenvalues).max(initial=0.0))
    if largest > 1.0 and longest * np.log(largest) > _LARGEST_GROWTH:
        raise IdentificationError(
            f"an eigenvalue of magnitude {largest:.4f} grows beyond all bounds in {longest} "
            "samples: stabilise the model first"
        )
    if np.linalg.cond(vectors) > _DEFECTIVE_CONDITION:
        return _fit_stepwise(A, C, inputs, records, feedthrough=feedthrough)
    regression = ModalRegression(
        eigenvalues.astype(complex), (C @ vectors).astype(complex), inputs, feedthrough=feedthrough
    )
    return _fit_modal(regression, vectors, records)


def _weight(powers: Sequence[FloatArray], records: Sequence[Samples]) -> FloatArray:
    """Return the inverse of each output's mean square, every record counting the same."""
    pairs = zip(powers, records, strict=True)
    power = np.mean([each / len(record) for each, record in pairs], axis=0)
    return np.asarray(np.divide(1.0, power, out=np.ones_like(power), where=power > 0.0))


def _relative_error(missed: Sequence[FloatArray], powers: Sequence[FloatArray]) -> FloatArray:
    total = np.sum(powers, axis=0)
    part = np.divide(np.sum(missed, axis=0), total, out=np.zeros_like(total), where=total > 0.0)
    return np.asarray(np.sqrt(part))


def _fit_modal(
    regression: ModalRegression, vectors: ComplexArray, records: Sequence[Samples]
) -> OutputFit:
    states, shared = len(vectors), regression.shared
    # B and D once, then an initial state per record.
    places = [
        np.r_[:shared, shared + number * states + np.arange(states)]
        for number in range(len(records))
    ]
    size = shared + len(records) * states
    products = [regression.products(record) for record in records]
    powers = [each.power for each in products]
    weight = _weight(powers, records)
    normal = np.zeros((size, size), dtype=complex)
    for place, each in zip(places, products, strict=True):
        normal[np.ix_(place, place)] += regression.normal(each, weight)
    inverse, rank, condition = _pseudo_inverse(normal)

    def solve(products: Sequence[Products]) -> tuple[ComplexArray, list[Missed]]:
        right = np.zeros(size, dtype=complex)
        for place, each in zip(places, products, strict=True):
            right[place] += regression.right(each, weight)
        found = inverse(right)
        weights = [regression.signal_weights(found[place]) for place in places]
        pairs = zip(products, weights, strict=True)
        return found, [each.missed(combination) for each, combination in pairs]

    parameters, missed = solve(products)
    # Normal equations square the condition, and small errors drown in the outputs' power: what
    # the first solution misses, sample by sample, gives the digits back.
    if condition > _WELL_CONDITIONED or any(each.is_rounding for each in missed):
        products = [
            regression.residual_products(record, parameters[place])
            for record, place in zip(records, places, strict=True)
        ]
        change, missed = solve(products)
        parameters = parameters + change
    B, D, x0 = _unpacked(parameters, regression.outputs, regression.inputs, states, shared)
    return OutputFit(
        (vectors @ B).real,
        D.real,
        tuple((vectors @ start).real for start in x0),
        _relative_error([each.power for each in missed], powers),
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
    A: FloatArray, C: FloatArray, inputs: int, records: Sequence[Samples], *, feedthrough: bool
) -> OutputFit:
    """Fit without eigenvectors, for an A that has no full set: (2-14) step by step, then QR."""
    (m, n), r = C.shape, inputs
    shared = r * n + (m * r if feedthrough else 0)
    size = shared + len(records) * n
    powers = [
        np.sum([np.sum(y**2, axis=0) for _, y in record.chunks(_CHUNK)], axis=0)
        for record in records
    ]
    weight = _weight(powers, records)
    triangle = np.zeros((0, size + 1))
    for number, record in enumerate(records):
        own = slice(shared + number * n, shared + (number + 1) * n)
        response, free = np.zeros((r, n, n)), np.eye(n)
        for u_rows, y_rows in record.chunks(_ROWS_AT_ONCE):
            rows = np.zeros((len(u_rows), m, size + 1))
            for k, u_k in enumerate(u_rows):
                rows[k, :, : r * n] = (C @ response).transpose(1, 0, 2).reshape(m, r * n)
                rows[k, :, own] = C @ free
                response = A @ response + u_k[:, np.newaxis, np.newaxis] * np.eye(n)
                free = A @ free
            if feedthrough:
                rows[:, :, r * n : shared] = np.kron(np.eye(m), u_rows[:, np.newaxis])
            rows[:, :, -1] = y_rows
            rows *= np.sqrt(weight)[:, np.newaxis]
            stacked = np.vstack([triangle, rows.reshape(-1, size + 1)])
            triangle = linalg.qr(stacked, mode="r")[0][: size + 1]
    length = np.linalg.norm(triangle[:, :-1], axis=0)
    length[length == 0.0] = 1.0
    solution, _, rank, values = np.linalg.lstsq(triangle[:, :-1] / length, triangle[:, -1])
    B, D, x0 = _unpacked(solution / length, m, r, n, shared)
    missed = []
    for record, start in zip(records, x0, strict=True):
        model = BlockSimulation(A, B, C, D, start)
        errors = (y - model.advance(u) for u, y in record.chunks(_CHUNK))
        missed.append(np.sum([np.sum(error**2, axis=0) for error in errors], axis=0))
    condition = float(values[0] / max(values[-1], np.finfo(float).eps * values[0]))
    return OutputFit(B, D, tuple(x0), _relative_error(missed, powers), int(rank), condition)

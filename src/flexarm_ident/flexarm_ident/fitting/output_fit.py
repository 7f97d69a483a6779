"""Output least squares for B, D and x0 (2-13 .. 2-17, 3-11 .. 3-18), and for C (3-19 .. 3-21).

Given A and C the outputs are linear in B, D and the initial states. Each output is weighted by the
inverse of its RMS, which minimises the sum of the squared relative errors (2-25) in any unit. On
request the weight is the inverse of the RMS residual of such a fit, the best choice for white
residuals.

B and D are common to all records, and each record has an initial state. Both forms keep products of
the data only, so that a solution for other weights of the outputs needs no further reading.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.errors import IdentificationError
from flexarm_ident.fitting.modal_regression import ModalRegression, ModalSignals, SchurRegression
from flexarm_ident.models.modes import is_defective
from flexarm_ident.models.state_space import simulate, simulate_states, spectrum
from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import control

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.fitting.modal_regression import Missed, Products
    from flexarm_ident.models.state_space import Spectrum
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.records.source import Samples, Source

_LARGEST_GROWTH = 100.0
# Smallest noise that weights an output, as a part of its RMS.
_SMALLEST_NOISE = 1e-4
# Its square costs six of sixteen digits.
_WELL_CONDITIONED = 1e3


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
        Relative simulation error of each output over all records (2-25); NaN for one that is zero.
    missed : tuple of ndarray, (outputs,)
        Sums of the squares of each record's simulation errors.
    rank : int
        Numerical rank of the regression.
    condition : float
        Condition number of the regressors, each scaled to unit length.
    """

    B: FloatArray
    D: FloatArray
    x0: tuple[FloatArray, ...]
    error: FloatArray
    missed: tuple[FloatArray, ...]
    rank: int
    condition: float


class OutputMatrixFit(NamedTuple):
    """C, (outputs, states), with rank and condition number of the states over time."""

    C: FloatArray
    rank: int
    condition: float


def fit_inputs(
    A: FloatArray,
    C: FloatArray,
    records: Sequence[Source],
    *,
    feedthrough: bool = False,
    noise_weighted: bool = False,
    at_rest: bool = False,
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
    noise_weighted : bool
        Weight each output by the inverse of a first fit's residual instead of its RMS, so that
        outputs with little noise count more.
    at_rest : bool
        Fit as (2-14) and (2-17) are printed: every record starts from rest, and no output has a
        weight.

    Raises
    ------
    IdentificationError
        If A is so unstable that its response overflows.
    """
    (fit,) = fit_each(
        *([spectrum(A)], C, records),
        feedthrough=feedthrough,
        noise_weighted=noise_weighted,
        at_rest=at_rest,
    )
    return fit


def fit_each(
    spectra: Sequence[Spectrum],
    C: FloatArray,
    records: Sequence[Source],
    *,
    feedthrough: bool,
    noise_weighted: bool,
    at_rest: bool,
) -> list[OutputFit]:
    """Fit the inputs as `fit_inputs` does, for several state matrices.

    The records are read once for all of them.

    Parameters
    ----------
    spectra : sequence of Spectrum
        State matrices, such as those of `state_space.moved` from one start.
    C : ndarray, (outputs, states)
        Output matrix of all of them.
    records, feedthrough, noise_weighted, at_rest
        As in `fit_inputs`.

    Returns
    -------
    list of OutputFit
        A fit for each state matrix, in their order.

    Raises
    ------
    IdentificationError
        If one of them is so unstable that its response overflows.
    """
    inputs = len(records[0].inputs)
    problems = _problems(spectra, C, inputs, records, feedthrough=feedthrough)
    return [
        _solved(problem, records, noise_weighted=noise_weighted, at_rest=at_rest)
        for problem in problems
    ]


def fit_initial_states(
    model: control.StateSpace, records: Sequence[IoData]
) -> tuple[FloatArray, ...]:
    """Fit each record's initial state to its outputs, given the whole model.

    The simulation continues through holes, where the input is known and the outputs do not count.

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
    missed = [_FreeResponse(record.y_usable - simulate(model, record.u)) for record in records]
    (problem,) = _problems([spectrum(model.A)], model.C, 0, missed, feedthrough=False)
    return _solved(problem, missed, noise_weighted=False, at_rest=False).x0


def fit_outputs(
    model: control.StateSpace, x0: Sequence[FloatArray], records: Sequence[IoData]
) -> OutputMatrixFit:
    """Fit C to the outputs, given A, B, D and the records' initial states (3-19 .. 3-21).

    Each output has its own row of C and its own regression, so weights do not matter. The C of the
    model is not used.
    """
    states = [
        simulate_states(model.A, model.B, record.u, start)[record.usable]
        for record, start in zip(records, x0, strict=True)
    ]
    outputs = [(record.y - record.u @ model.D.T)[record.usable] for record in records]
    found = least_squares(np.vstack(states), np.vstack(outputs))
    return OutputMatrixFit(found.solution.T, found.rank, found.condition)


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


def _problems(
    spectra: Sequence[Spectrum],
    C: FloatArray,
    inputs: int,
    records: Sequence[Samples],
    *,
    feedthrough: bool,
) -> list[ModalProblem] | list[SchurProblem]:
    longest = max(len(record) for record in records)
    for each in spectra:
        largest = float(np.abs(each.eigenvalues).max(initial=0.0))
        if largest > 1.0 and longest * np.log(largest) > _LARGEST_GROWTH:
            raise IdentificationError(
                f"an eigenvalue of magnitude {largest:.4f} makes the response overflow in "
                f"{longest} samples: take a shorter part of the record, or have "
                "unstable eigenvalues moved"
            )
    if any(is_defective(each.vectors) for each in spectra):
        return [
            SchurProblem(SchurRegression(each.A, C, inputs, feedthrough=feedthrough), records)
            for each in spectra
        ]
    eigenvalues = np.unique(np.concatenate([each.eigenvalues for each in spectra]))
    modes = eigenvalues[eigenvalues.imag >= 0.0]
    signals = ModalSignals(modes, inputs, len(C), feedthrough=feedthrough)
    products = [signals.products(record) for record in records]
    return [ModalProblem(signals, products, each, C, records) for each in spectra]


def _solved(
    problem: ModalProblem | SchurProblem,
    records: Sequence[Samples],
    *,
    noise_weighted: bool,
    at_rest: bool,
) -> OutputFit:
    power = _mean(problem.powers, records)
    weight = np.ones_like(power) if at_rest else _inverse(power)
    if noise_weighted:
        missed = _mean(problem.solve(weight, refined=False, at_rest=at_rest).missed, records)
        weight = _inverse(np.maximum(missed, _SMALLEST_NOISE**2 * power))
    found = problem.solve(weight, refined=True, at_rest=at_rest)
    error = _relative_error(found.missed, problem.powers)
    return OutputFit(
        *(found.B, found.D, found.x0, error, tuple(found.missed)), found.rank, found.condition
    )


def _mean(powers: Sequence[FloatArray], records: Sequence[Samples]) -> FloatArray:
    """Return each output's mean square, every record counting the same."""
    pairs = zip(powers, records, strict=True)
    return np.asarray(np.mean([each / len(record) for each, record in pairs], axis=0))


def _inverse(power: FloatArray) -> FloatArray:
    return np.asarray(np.divide(1.0, power, out=np.ones_like(power), where=power > 0.0))


def _relative_error(missed: Sequence[FloatArray], powers: Sequence[FloatArray]) -> FloatArray:
    total = np.sum(powers, axis=0)
    none = np.full_like(total, np.nan)
    part = np.divide(np.sum(missed, axis=0), total, out=none, where=total > 0.0)
    return np.asarray(np.sqrt(part))


class Solution(NamedTuple):
    """B, D, initial states, each record's squared error by output, rank and condition number."""

    B: FloatArray
    D: FloatArray
    x0: tuple[FloatArray, ...]
    missed: list[FloatArray]
    rank: int
    condition: float


class ModalProblem:
    """Normal equations of all records in modal coordinates: common B and D, x0 per record.

    Parameters
    ----------
    signals : ModalSignals
        Signals of the modes of A.
    products : sequence of Products
        Their products over each record.
    dynamics : Spectrum
        A, its eigenvalues and eigenvectors.
    C : ndarray, (outputs, states)
        Output matrix.
    records : sequence of Samples
        The records.
    """

    def __init__(
        self,
        signals: ModalSignals,
        products: Sequence[Products],
        dynamics: Spectrum,
        C: FloatArray,
        records: Sequence[Samples],
    ) -> None:
        vectors = dynamics.vectors
        regression = ModalRegression(signals, dynamics.eigenvalues, C @ vectors)
        self._products = [regression.of_parameters(each) for each in products]
        self._signals, self._regression = signals, regression
        self._vectors, self._records = vectors, records
        states, shared = len(vectors), regression.shared
        self._places = [
            np.r_[:shared, shared + number * states + np.arange(states)]
            for number in range(len(records))
        ]
        self._size = shared + len(records) * states
        self.powers = [each.power for each in products]

    def solve(self, weight: FloatArray, *, refined: bool, at_rest: bool) -> Solution:
        """Solve the normal equations for weights of the squared errors, (outputs,).

        With `refined` the records are read once more where digits were lost, and the condition
        number is told. Records `at_rest` have no initial states.
        """
        regression, size = self._regression, self._size
        free = slice(0, regression.shared if at_rest else size)
        normal = np.zeros((size, size), dtype=complex)
        for place, each in zip(self._places, self._products, strict=True):
            normal[np.ix_(place, place)] += regression.normal(each, weight)
        smallest = size * np.finfo(float).eps
        inverse = truncated_inverse(normal[free, free], smallest=smallest, equilibrated=True)
        condition = float(np.sqrt(inverse.condition)) if refined else np.nan

        def solve(products: Sequence[Products]) -> tuple[ComplexArray, list[Missed]]:
            right = np.zeros(size, dtype=complex)
            for place, each in zip(self._places, products, strict=True):
                right[place] += regression.right(each, weight)
            found = np.zeros(size, dtype=complex)
            found[free] = inverse.solve(right[free])
            pairs = zip(products, self._places, strict=True)
            return found, [regression.missed(each, found[place]) for each, place in pairs]

        parameters, missed = solve(self._products)
        # Normal equations square the condition, and small errors vanish in the outputs' power. The
        # residual of the first solution, sample by sample, restores the digits.
        lost = condition > _WELL_CONDITIONED or any(each.is_rounding for each in missed)
        if refined and lost:
            weights = [regression.signal_weights(parameters[place]) for place in self._places]
            left = [
                regression.of_parameters(self._signals.residual_products(record, combination))
                for record, combination in zip(self._records, weights, strict=True)
            ]
            change, missed = solve(left)
            parameters = parameters + change
        states, shared = len(self._vectors), regression.shared
        B = parameters[: regression.inputs * states].reshape(regression.inputs, states).T
        D = np.zeros((regression.outputs, regression.inputs), dtype=complex)
        if shared > B.size:
            D = parameters[B.size : shared].reshape(D.shape)
        return Solution(
            (self._vectors @ B).real,
            D.real,
            tuple((self._vectors @ x).real for x in parameters[shared:].reshape(-1, states)),
            [each.power for each in missed],
            inverse.rank,
            condition,
        )


class SchurProblem:
    """Triangles of all records and outputs in Schur coordinates."""

    def __init__(self, regression: SchurRegression, records: Sequence[Samples]) -> None:
        self._regression = regression
        self._triangles = [regression.triangles(record) for record in records]
        self.powers = [np.sum(each[:, :, -1] ** 2, axis=1) for each in self._triangles]

    def solve(self, weight: FloatArray, *, refined: bool, at_rest: bool) -> Solution:  # noqa: ARG002 - one interface
        """Solve the triangles together; as in `ModalProblem`, but without loss of digits."""
        regression = self._regression
        n, m, driven = regression.states, regression.outputs, regression.states * regression.inputs
        D_first = driven + len(self._triangles) * n
        size = D_first + m * regression.direct
        blocks, targets, places = [], [], []
        for number, triangles in enumerate(self._triangles):
            for output, triangle in enumerate(triangles):
                place = np.r_[
                    :driven,
                    driven + number * n : driven + (number + 1) * n,
                    D_first + output * regression.direct : D_first
                    + (output + 1) * regression.direct,
                ]
                rows = np.zeros((len(triangle), size))
                rows[:, place] = np.sqrt(weight[output]) * triangle[:, :-1]
                if at_rest:
                    rows[:, driven:D_first] = 0.0
                blocks.append(rows)
                targets.append(np.sqrt(weight[output]) * triangle[:, -1])
                places.append(place)
        found = least_squares(np.vstack(blocks), np.concatenate(targets))
        parameters = found.solution
        missed = [
            np.array(
                [
                    np.sum((triangle[:, :-1] @ parameters[place] - triangle[:, -1]) ** 2)
                    for triangle, place in zip(
                        triangles, places[number * m : (number + 1) * m], strict=True
                    )
                ]
            )
            for number, triangles in enumerate(self._triangles)
        ]
        Z = regression.basis
        return Solution(
            Z @ parameters[:driven].reshape(-1, n).T,
            parameters[D_first:].reshape(m, -1)
            if regression.direct
            else np.zeros((m, regression.inputs)),
            tuple(Z @ x for x in parameters[driven:D_first].reshape(-1, n)),
            missed,
            found.rank,
            found.condition,
        )


class LeastSquares(NamedTuple):
    """Solution of a linear least squares, with rank and condition of its scaled regressors."""

    solution: FloatArray
    rank: int
    condition: float


def least_squares(regressors: FloatArray, targets: FloatArray) -> LeastSquares:
    """Solve with columns scaled to unit length."""
    length = np.linalg.norm(regressors, axis=0)
    length[length == 0.0] = 1.0
    solution, _, rank, values = np.linalg.lstsq(regressors / length, targets)
    condition = float(values[0] / max(values[-1], np.finfo(float).eps * values[0]))
    return LeastSquares((solution.T / length).T, int(rank), condition)

"""Output least squares over all records, in modal or in Schur coordinates.

B and D are common to all records, and each record has an initial state. Both forms keep products of
the data only, so that a solution for other weights of the outputs needs no further reading.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.fitting.modal_regression import ModalRegression
from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.fitting.modal_regression import Missed, ModalSignals, Products
    from flexarm_ident.fitting.schur_regression import SchurRegression
    from flexarm_ident.models.state_space import Spectrum
    from flexarm_ident.records.source import Samples

# Its square costs six of sixteen digits.
_WELL_CONDITIONED = 1e3


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

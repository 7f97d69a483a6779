"""Parameters of a model in real modal form, for fits that change all its matrices.

A has two parameters per pair there instead of a full matrix, and a mode depends on its own ones
alone. They stand in the order A by modes, B by rows, C by rows, and the end vectors of each record:
its initial state, or what stands for it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.fitting.levenberg_marquardt import minimise
from flexarm_ident.models.modes import modal_form
from flexarm_ident.models.state_space import INTEGRATOR_RADIUS, with_matrices

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control
    from numpy.typing import NDArray

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.fitting.levenberg_marquardt import Minimum, Normal

    IntArray = NDArray[np.intp]


class ModalParameters(ABC):
    """Sum of squares over parameters A, B, C and end vectors of a model; D stays.

    No eigenvalue leaves the unit circle, but for one that begins outside.

    Parameters
    ----------
    model : control.StateSpace
        Discrete model with a basis of eigenvectors.
    """

    def __init__(self, model: control.StateSpace) -> None:
        form = modal_form(model)
        self._start, self.groups = model, form.groups
        # Columns of a pair: real and imaginary part of its vector.
        self._basis = np.empty((model.nstates, model.nstates))
        for group in self.groups:
            vector = form.vectors[:, group[0]]
            self._basis[:, group[0]] = vector.real
            if len(group) > 1:
                self._basis[:, group[1]] = vector.imag
        self._largest = max(INTEGRATOR_RADIUS, float(np.abs(form.eigenvalues).max(initial=0.0)))
        self.n, self.r, self.m = int(model.nstates), int(model.ninputs), int(model.noutputs)

    @abstractmethod
    def cost(self, theta: FloatArray) -> float:
        """Return the sum of squares."""

    @abstractmethod
    def normal(self, theta: FloatArray) -> Normal:
        """Return cost, gradient and the product of the Jacobian with itself."""

    def minimised(
        self,
        theta: FloatArray,
        *,
        iterations: int,
        tolerance: float = 1e-5,
        on_step: Callable[[], None] = lambda: None,
    ) -> Minimum:
        """Return the minimum that is found from some parameters, see `minimise`."""
        return minimise(
            *(theta, self.cost, self.normal),
            allowed=self.allowed,
            iterations=iterations,
            tolerance=tolerance,
            on_step=on_step,
        )

    @property
    def dynamic(self) -> int:
        """Number of parameters of A and B, which come first."""
        return self.n * (1 + self.r)

    def columns(self, output: int, record: int) -> IntArray:
        """Return the parameters of an output in a record: A, B, end vector and row of C."""
        n, states = self.n, np.arange(self.n)
        own, row = self.dynamic + n * (self.m + record), self.dynamic + n * output
        return np.concatenate([np.arange(self.dynamic), own + states, row + states])

    def pack(self, ends: Sequence[FloatArray]) -> FloatArray:
        """Return the parameters of the model with end vectors in its coordinates."""
        inverse = np.linalg.inv(self._basis)
        A = inverse @ self._start.A @ self._basis
        entries = []
        for group in self.groups:
            entries.append(A[group[0], group[0]])
            if len(group) > 1:
                entries.append(A[group[0], group[1]])
        B, C = inverse @ self._start.B, self._start.C @ self._basis
        return np.concatenate([entries, B.ravel(), C.ravel(), *(inverse @ x for x in ends)])

    def model(self, theta: FloatArray) -> control.StateSpace:
        """Return the model of some parameters, in the coordinates of the start."""
        A, B, C, _ = self.split(theta)
        T, inverse = self._basis, np.linalg.inv(self._basis)
        return with_matrices(self._start, A=T @ A @ inverse, B=T @ B, C=C @ inverse)

    def ends(self, theta: FloatArray) -> tuple[FloatArray, ...]:
        """Return the end vectors of some parameters, in the coordinates of the start."""
        return tuple(self._basis @ end for end in self.split(theta)[-1])

    def without(
        self, theta: FloatArray, group: tuple[int, ...]
    ) -> tuple[control.StateSpace, tuple[FloatArray, ...]]:
        """Return model and end vectors with one mode left out, in modal coordinates."""
        A, B, C, ends = self.split(theta)
        kept = np.delete(np.arange(self.n), group)
        model = with_matrices(self._start, A=A[np.ix_(kept, kept)], B=B[kept], C=C[:, kept])
        return model, tuple(end[kept] for end in ends)

    def allowed(self, theta: FloatArray) -> FloatArray:
        """Return parameters whose eigenvalues are no larger than allowed, the others unchanged."""
        allowed, at = theta.copy(), 0
        for group in self.groups:
            entries = slice(at, at + len(group))
            radius = float(np.linalg.norm(theta[entries]))
            if radius > self._largest:
                allowed[entries] *= self._largest / radius
            at += len(group)
        return allowed

    def split(
        self, theta: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, tuple[FloatArray, ...]]:
        """Return A, B, C and the end vectors in modal coordinates."""
        n, r, m = self.n, self.r, self.m
        A, at = np.zeros((n, n)), 0
        for group in self.groups:
            i = group[0]
            A[i, i] = theta[at]
            if len(group) > 1:
                j = group[1]
                A[i, j], A[j, i], A[j, j] = theta[at + 1], -theta[at + 1], theta[at]
            at += len(group)
        B = theta[n : n + n * r].reshape(n, r)
        C = theta[n + n * r : n + n * r + n * m].reshape(m, n)
        ends = theta[n + n * r + n * m :].reshape(-1, n)
        return A, B.copy(), C.copy(), tuple(end.copy() for end in ends)


class PoleForm:
    """Model as a sum over its poles: ``y = sum of gamma (beta u) / (z - pole)``.

    Attributes
    ----------
    poles : ndarray, (states,)
        Eigenvalues, those of a pair one after the other.
    beta : ndarray, (inputs + records, states)
        Factors of the inputs, and of the end vectors.
    gamma : ndarray, (outputs, states)
        Factors of the outputs.
    """

    def __init__(self, parameters: ModalParameters, theta: FloatArray) -> None:
        A, B, C, ends = parameters.split(theta)
        n = parameters.n
        pairs = [group for group in parameters.groups if len(group) > 1]
        first, second = (np.array([group[side] for group in pairs], dtype=int) for side in (0, 1))
        self.poles = np.diag(A).astype(complex)
        self.poles[first] += 1j * A[first, second]
        self.poles[second] -= 1j * A[first, second]
        # The entries of a pair are real and imaginary part of one side; the other is its conjugate.
        self._sides = np.eye(n, dtype=complex)
        self._sides[first, second], self._sides[second, first] = 1j, 1.0
        self._sides[second, second] = -1j
        half = np.ones(n)
        half[first] = half[second] = 0.5
        self._half = half
        driven = np.vstack([B.T, np.reshape(ends, (-1, n))])
        self.beta = driven @ self._sides.conj().T
        self.gamma = half * (C @ self._sides.T)

    def beta_of(self, record: int, inputs: int) -> ComplexArray:
        """Return the factors of the inputs, and of the end vector of one record."""
        return self.beta[[*range(inputs), inputs + record]]

    def derivatives(self, output: int, inputs: int) -> ComplexArray:
        """Return what turns derivatives by poles into those by the parameters of an output.

        The former are, each for all poles: the response to beta over the square of ``z - pole``,
        the response to each input and to the end vector, the response to beta. The latter stand in
        the order of `ModalParameters.columns`.
        """
        n, gamma = len(self.poles), self.gamma[output][:, np.newaxis]
        turn = np.zeros((n * (inputs + 3),) * 2, dtype=complex)
        states = np.arange(n)
        turn[np.ix_(states, states)] = gamma * self._sides
        for given in range(inputs):
            turn[np.ix_(n * (1 + given) + states, n + inputs * states + given)] = (
                gamma * self._sides.conj()
            )
        end, row = n * (1 + inputs) + states, n * (2 + inputs) + states
        turn[np.ix_(end, end)] = gamma * self._sides.conj()
        turn[np.ix_(row, row)] = self._half[:, np.newaxis] * self._sides
        return turn

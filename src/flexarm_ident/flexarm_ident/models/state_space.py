"""Discrete state-space models with named channels: stabilisation and free simulation.

python-control takes longer to import than all else together: it comes with the first model.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from flexarm_ident.models.control_library import control_library

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control
    from numpy.typing import ArrayLike, NDArray

    from flexarm_core.arrays import ComplexArray, FloatArray

STABLE_RADIUS = 0.9999
"""Magnitude that the thesis gives an unstable eigenvalue (section 3.2, third example)."""
Way = Literal["mirror", "clamp", "integrator", "drag"]
"""Way to move an unstable eigenvalue."""
WAYS: tuple[Way, ...] = ("mirror", "clamp", "integrator", "drag")
"""All of them."""
INTEGRATING: frozenset[Way] = frozenset({"integrator", "drag"})
"""Ways that make an integrator of an eigenvalue near 1."""
INTEGRATOR_RADIUS = 1.0 - 1e-8
"""Magnitude of an integrator: 100 million samples, and clear of the rounding of eigenvalues."""
# Estimates of an integrator's eigenvalue lie within that distance of 1.
NEAR_ONE = 2.0 / 3000.0
# Part by which eigenvalues that come to the same place are kept from each other.
_APART = 1e-6
_PAIR = 2
_SAME_PLACE = 1e-9
_BLOCK = 32


def state_space(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    D: ArrayLike,
    dt_s: float,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    name: str | None = None,
) -> control.StateSpace:
    """Return a discrete model with named channels.

    Parameters
    ----------
    A : array_like, (states, states)
        State matrix.
    B : array_like, (states, inputs)
        Input matrix.
    C : array_like, (outputs, states)
        Output matrix.
    D : array_like, (outputs, inputs)
        Feedthrough matrix; 0.0 is a zero matrix.
    dt_s : float
        Sampling period.
    inputs, outputs : sequence of str, optional
        Names of the channels.
    name : str, optional
        Name of the model.
    """
    names = {"inputs": inputs and list(inputs), "outputs": outputs and list(outputs), "name": name}
    model: control.StateSpace = control_library().StateSpace(A, B, C, D, dt_s, **names)
    return model


def with_matrices(
    model: control.StateSpace,
    *,
    A: ArrayLike | None = None,
    B: ArrayLike | None = None,
    C: ArrayLike | None = None,
    D: ArrayLike | None = None,
) -> control.StateSpace:
    """Return a model with some matrices replaced, of the same period and channels."""
    return state_space(
        model.A if A is None else A,
        model.B if B is None else B,
        model.C if C is None else C,
        model.D if D is None else D,
        model.dt,
        inputs=model.input_labels,
        outputs=model.output_labels,
    )


def is_stable(A: FloatArray) -> bool:
    """Return whether all eigenvalues lie inside the unit circle."""
    return bool(np.abs(np.linalg.eigvals(A)).max(initial=0.0) < 1.0)


def stabilise(A: FloatArray, way: Way = "mirror") -> tuple[FloatArray, int]:
    """Move the eigenvalues on or outside the unit circle inside, keeping the other modes.

    The frequencies stay. Real eigenvalues that would come to the same place are kept a millionth
    from each other, since equal ones have no modes of their own. There are four ways:

    - ``mirror``: the magnitude r becomes 1/r, which turns growth into decay of the same rate, and
      0.9999 at most;
    - ``clamp``: the magnitude becomes 0.9999, as the thesis does with 1.0000235;
    - ``integrator``: as ``clamp``, but an eigenvalue less than 2/3000 from 1, on either side of the
      circle, is an integrator and becomes 1 - 1e-8. 0.9999 is a time constant of 10,000 samples,
      which a free hub does not have;
    - ``drag``: as ``integrator``, but of two eigenvalues near 1 only one integrates, and the other
      keeps their sum: a free hub with viscous friction. A record tells the sum well, and how far
      apart they are badly, so that an estimate is often a complex pair.

    Parameters
    ----------
    A : ndarray, (states, states)
        State matrix.
    way : {"mirror", "clamp", "integrator", "drag"}
        Way to move them.

    Returns
    -------
    ndarray, (states, states)
        The stable matrix; `A` itself when there is nothing to move.
    int
        Number of eigenvalues on or outside the unit circle.
    """
    found = moved(spectrum(A), way)
    return found.A, found.unstable


class Spectrum(NamedTuple):
    """State matrix with its eigenvalues and eigenvectors.

    Attributes
    ----------
    A : ndarray, (states, states)
        State matrix.
    eigenvalues : ndarray, (states,)
        Complex eigenvalues, conjugates side by side.
    vectors : ndarray, (states, states)
        Eigenvectors as columns.
    unstable : int
        Number of eigenvalues that have been moved from outside the unit circle or from it.
    """

    A: FloatArray
    eigenvalues: ComplexArray
    vectors: ComplexArray
    unstable: int = 0


def spectrum(A: FloatArray) -> Spectrum:
    """Return a state matrix, (states, states), with its eigenvalues and eigenvectors."""
    eigenvalues, vectors = np.linalg.eig(A)
    return Spectrum(A, eigenvalues.astype(complex), vectors.astype(complex))


def moved(start: Spectrum, way: Way) -> Spectrum:
    """Return a state matrix with moved eigenvalues.

    The eigenvectors stay, but for those of a complex pair that becomes two real ones.

    Parameters
    ----------
    start : Spectrum
        State matrix as estimated.
    way : {"mirror", "clamp", "integrator", "drag"}
        Way to move them, see `stabilise`.

    Returns
    -------
    Spectrum
        The stable matrix; `start` itself when there is nothing to move.
    """
    unstable = int(np.sum(np.abs(start.eigenvalues) >= 1.0))
    eigenvalues, vectors = start.eigenvalues, start.vectors
    near = (np.abs(eigenvalues - 1.0) < NEAR_ONE) & (way in INTEGRATING)
    if way == "drag":
        eigenvalues, vectors, near = _with_drag(start, near)
    radius = np.abs(eigenvalues)
    outside = radius >= 1.0
    if not (outside | near).any():
        return start
    inner = np.full_like(radius, STABLE_RADIUS)
    if way == "mirror":
        np.divide(1.0, radius, out=inner, where=radius > 1.0 / STABLE_RADIUS)
    target = np.where(near, INTEGRATOR_RADIUS, np.where(outside, inner, radius))
    # Those that stay do so to the last bit: fits of several ways share what depends on them.
    factor = np.divide(target, radius, out=np.ones_like(radius), where=radius > 0.0)
    inside = np.where(target == radius, eigenvalues, eigenvalues * factor)
    inside = _kept_apart(inside, np.flatnonzero((outside | near) & (inside.imag == 0.0)), radius)
    stable = np.linalg.solve(vectors.T, (vectors * inside).T).T.real
    largest = np.abs(np.linalg.eigvals(stable)).max()
    if largest >= 1.0:
        # Eigenvectors so close to each other do not allow moving one eigenvalue alone.
        stable, inside = stable * (STABLE_RADIUS / largest), inside * (STABLE_RADIUS / largest)
    return Spectrum(np.asarray(stable), inside, vectors, unstable)


def _with_drag(
    start: Spectrum, near: NDArray[np.bool_]
) -> tuple[ComplexArray, ComplexArray, NDArray[np.bool_]]:
    """Return eigenvalues and vectors where one of two near 1 keeps their sum, and the integrators.

    A pair stays when that sum leaves no drag.
    """
    eigenvalues, vectors, near = start.eigenvalues.copy(), start.vectors.copy(), near.copy()
    real = np.flatnonzero(near & (eigenvalues.imag == 0.0))
    pairs = [(i, i + 1) for i in np.flatnonzero(near & (eigenvalues.imag > 0.0))]
    if len(real) == _PAIR:
        pairs.append(tuple(real[np.argsort(-eigenvalues[real].real)]))
    for first, second in pairs:
        drag = eigenvalues[first].real + eigenvalues[second].real - INTEGRATOR_RADIUS
        if drag >= INTEGRATOR_RADIUS:
            continue
        if eigenvalues[first].imag > 0.0:
            vectors[:, [first, second]] = _real_vectors(
                vectors[:, first], eigenvalues[first].imag, 0.5 * (INTEGRATOR_RADIUS - drag)
            )
        eigenvalues[first], eigenvalues[second] = INTEGRATOR_RADIUS, drag
        near[second] = False
    return eigenvalues, vectors, near


def _real_vectors(vector: ComplexArray, imaginary: float, apart: float) -> FloatArray:
    """Return eigenvectors, (states, 2), for a pair that becomes two real eigenvalues.

    In the principal axes of the pair's plane its part of A has two elements off the diagonal. The
    smaller one changes, so that the eigenvalues are `apart` from their mean, on either side.
    """
    turned = vector * np.exp(-0.5j * np.angle(vector @ vector))
    longer, shorter = np.linalg.norm(turned.real), np.linalg.norm(turned.imag)
    slope = imaginary * longer / shorter / apart
    along, across = slope * turned.real / longer, turned.imag / shorter
    found = np.stack([along + across, across - along], axis=1)
    return np.asarray(found / np.linalg.norm(found, axis=0))


def _kept_apart(moved: ComplexArray, real: NDArray[np.intp], radius: FloatArray) -> ComplexArray:
    """Part the `real` ones among moved eigenvalues; the one that was farthest outside comes first.

    Any mix of two equal modes is one, and the rounding of a processor would choose among them.
    """
    parted = moved.copy()
    taken: list[complex] = []
    for i in sorted(real, key=lambda each: -radius[each]):
        same = sum(abs(moved[i] - other) < _SAME_PLACE for other in taken)
        taken.append(moved[i])
        parted[i] = moved[i] * (1.0 - same * _APART)
    return parted


def simulate(model: control.StateSpace, u: FloatArray, x0: FloatArray | None = None) -> FloatArray:
    """Simulate (2-3).

    The state is stepped over blocks of samples, and the outputs inside a block follow by one matrix
    product: python-control's `forced_response` takes 34 times as long for 3000 samples. The
    response of an unstable model may overflow to infinity.

    Parameters
    ----------
    model : control.StateSpace
        Discrete model.
    u : ndarray, (samples, inputs)
        Input.
    x0 : ndarray, (states,), optional
        Initial state; zero by default.

    Returns
    -------
    ndarray, (samples, outputs)
        Output.
    """
    return BlockSimulation(model.A, model.B, model.C, model.D, x0).advance(u)


def simulate_states(
    A: FloatArray, B: FloatArray, u: FloatArray, x0: FloatArray | None = None
) -> FloatArray:
    """Simulate the states of (2-3), (samples, states), Z of (3-21) transposed; see `simulate`."""
    states = len(A)
    return BlockSimulation(A, B, np.eye(states), np.zeros((states, u.shape[1])), x0).advance(u)


class BlockSimulation:
    """Simulation of (2-3) that continues from one piece of the input to the next.

    Parameters
    ----------
    A, B, C, D : ndarray
        Matrices of the model.
    x0 : ndarray, (states,), optional
        Initial state; zero by default.
    """

    def __init__(
        self,
        A: FloatArray,
        B: FloatArray,
        C: FloatArray,
        D: FloatArray,
        x0: FloatArray | None = None,
    ) -> None:
        self._x = np.zeros(len(A)) if x0 is None else np.array(x0, dtype=np.float64)
        with np.errstate(over="ignore", invalid="ignore"):
            self._powers = [np.eye(len(A))]
            for _ in range(_BLOCK):
                self._powers.append(A @ self._powers[-1])
            self._drive = np.hstack([power @ B for power in self._powers[_BLOCK - 1 :: -1]]).T
            self._observe = np.vstack([C @ power for power in self._powers[:_BLOCK]])
            self._pulses = _pulse_responses(self._observe, B, C, D)

    @property
    def state(self) -> FloatArray:
        """State at the next sample, (states,)."""
        return self._x

    def advance(self, u: FloatArray) -> FloatArray:
        """Return the outputs, (samples, outputs), for the next inputs, (samples, inputs)."""
        samples, inputs = u.shape
        whole, rest = divmod(samples, _BLOCK)
        padded = np.zeros((-(-samples // _BLOCK) * _BLOCK, inputs))
        padded[:samples] = u
        u_blocks = padded.reshape(-1, _BLOCK * inputs)
        starts = np.empty((len(u_blocks), len(self._x)))
        with np.errstate(over="ignore", invalid="ignore"):
            drive = u_blocks[:whole] @ self._drive
            x, step = self._x, self._powers[_BLOCK]
            for b in range(whole):
                starts[b] = x
                x = step @ x + drive[b]
            if rest:
                starts[whole] = x
                last = u[whole * _BLOCK :].ravel() @ self._drive[(_BLOCK - rest) * inputs :]
                x = self._powers[rest] @ x + last
            self._x = x
            y_blocks = starts @ self._observe.T + u_blocks @ self._pulses.T
        return np.asarray(y_blocks.reshape(len(padded), -1)[:samples])


def _pulse_responses(
    observe: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray
) -> FloatArray:
    outputs, inputs = len(C), B.shape[1]
    pulses = np.vstack([D, observe[:-outputs] @ B])
    toeplitz = np.zeros((_BLOCK * outputs, _BLOCK * inputs))
    for column in range(_BLOCK):
        rows = pulses[: (_BLOCK - column) * outputs]
        toeplitz[column * outputs :, column * inputs : (column + 1) * inputs] = rows
    return toeplitz

"""Free simulation of a discrete model, in blocks of samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import control

    from flexarm_ident.arrays import FloatArray

_BLOCK = 32


def simulate(model: control.StateSpace, u: FloatArray, x0: FloatArray | None = None) -> FloatArray:
    """Simulate (2-3).

    The state is stepped over blocks of samples, the outputs inside a block follow by one matrix
    product. The response of an unstable model may overflow to infinity.

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
    return _simulate(model.A, model.B, model.C, model.D, u, x0=x0)


def simulate_states(
    A: FloatArray, B: FloatArray, u: FloatArray, x0: FloatArray | None = None
) -> FloatArray:
    """Simulate the states of (2-3), (samples, states); arguments as in `simulate`."""
    states = len(A)
    return _simulate(A, B, np.eye(states), np.zeros((states, u.shape[1])), u, x0=x0)


def _simulate(
    A: FloatArray,
    B: FloatArray,
    C: FloatArray,
    D: FloatArray,
    u: FloatArray,
    *,
    x0: FloatArray | None,
) -> FloatArray:
    samples, inputs = u.shape
    blocks = -(-samples // _BLOCK)
    padded = np.zeros((blocks * _BLOCK, inputs))
    padded[:samples] = u
    u_blocks = padded.reshape(blocks, _BLOCK * inputs)
    with np.errstate(over="ignore", invalid="ignore"):
        powers = [np.eye(len(A))]
        for _ in range(_BLOCK):
            powers.append(A @ powers[-1])
        drive = u_blocks @ np.hstack([power @ B for power in powers[_BLOCK - 1 :: -1]]).T
        starts = np.empty((blocks, len(A)))
        x = np.zeros(len(A)) if x0 is None else np.array(x0, dtype=np.float64)
        step = powers[_BLOCK]
        for b in range(blocks):
            starts[b] = x
            x = step @ x + drive[b]
        observe = np.vstack([C @ power for power in powers[:_BLOCK]])
        y_blocks = starts @ observe.T + u_blocks @ _pulse_responses(observe, B, C, D).T
    return y_blocks.reshape(blocks * _BLOCK, -1)[:samples]


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

"""Systems and records with known answers, for the tests of the identification."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import control
import numpy as np

from flexarm_ident import IoData

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

DT_S = 1.0 / 300.0


def random_model(
    seed: int, states: int = 5, outputs: int = 3, inputs: int = 2, *, feedthrough: bool = False
) -> control.StateSpace:
    rng = np.random.default_rng(seed)
    # Moderate, well separated eigenvalues: nothing in the answer hinges on luck.
    radius, angle = rng.uniform(0.5, 0.97, states), rng.uniform(0.2, 2.9, states // 2)
    A = np.zeros((states, states))
    for i, phi in enumerate(angle):
        rotation = [[np.cos(phi), np.sin(phi)], [-np.sin(phi), np.cos(phi)]]
        A[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = radius[i] * np.array(rotation)
    if states % 2:
        A[-1, -1] = radius[-1]
    T = np.linalg.qr(rng.normal(size=(states, states)))[0] @ np.diag(rng.uniform(0.5, 2.0, states))
    B, C = rng.normal(size=(states, inputs)), rng.normal(size=(outputs, states))
    D = rng.normal(size=(outputs, inputs)) if feedthrough else np.zeros((outputs, inputs))
    return named(T @ A @ np.linalg.inv(T), T @ B, C @ np.linalg.inv(T), D)


def named(A: Array, B: Array, C: Array, D: Array) -> control.StateSpace:
    inputs = [f"u{i}" for i in range(np.shape(B)[1])]
    outputs = [f"y{i}" for i in range(len(C))]
    return control.ss(A, B, C, D, DT_S, inputs=inputs, outputs=outputs)


def step_by_step(model: control.StateSpace, u: Array, x0: Array | None = None) -> Array:
    """Simulate (2-3) as it is written."""
    A, B, C, D = (np.asarray(M) for M in (model.A, model.B, model.C, model.D))
    x = np.empty((len(u) + 1, len(A)))
    x[0] = 0.0 if x0 is None else x0
    driven = u @ B.T
    for k in range(len(u)):
        x[k + 1] = A @ x[k] + driven[k]
    return np.asarray(x[:-1] @ C.T + u @ D.T)


def record(
    model: control.StateSpace,
    samples: int,
    seed: int,
    *,
    noise: float = 0.0,
    at_rest: bool = False,
    **fields: Any,  # noqa: ANN401 (fields of IoData)
) -> IoData:
    """Return a record with white input, from a random initial state unless at rest."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(samples, model.ninputs))
    x0 = np.zeros(model.nstates) if at_rest else rng.normal(size=model.nstates)
    y = step_by_step(model, u, x0)
    y += noise * y.std(axis=0) * rng.normal(size=y.shape)
    return IoData(
        u,
        y,
        dt_s=DT_S,
        inputs=tuple(model.input_labels),
        outputs=tuple(model.output_labels),
        **fields,
    )


def pulse_responses(model: control.StateSpace, count: int = 25) -> Array:
    """Return the Markov parameters D, CB, CAB, ...: they do not depend on the realisation."""
    x, responses = np.asarray(model.B), [np.asarray(model.D)]
    for _ in range(count):
        responses.append(model.C @ x)
        x = model.A @ x
    return np.array(responses)


def arm_model() -> control.StateSpace:
    """Return a rigid mode near 1 and three lightly damped modes, seen by four outputs."""
    modes_hz, damping = (9.4, 24.1, 45.6), (0.04, 0.03, 0.02)
    gains = ((0.02, -0.3, 0.25, 0.05), (0.01, 0.35, 0.3, 0.08), (0.004, -0.2, 0.25, 0.03))
    slow = 0.999
    A = np.array([[slow, DT_S, 0.0], [0.0, 0.98, 0.0], [0.0, 0.0, 0.3]])
    B, C = np.array([[0.0], [0.4], [0.2]]), np.zeros((4, 3))
    C[0, 0], C[3, 1], C[3, 2] = 0.2, 0.2, 0.05
    for hz, zeta, gain in zip(modes_hz, damping, gains, strict=True):
        s = 2.0 * np.pi * hz * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
        lam = np.exp(s * DT_S)
        block = np.array([[lam.real, lam.imag], [-lam.imag, lam.real]])
        zeros = np.zeros((len(A), 2))
        A = np.block([[A, zeros], [zeros.T, block]])
        B = np.vstack([B, [[0.1], [0.05]]])
        C = np.hstack([C, np.outer(gain, (1.0, 0.5))])
    outputs = ["position_v", "base_strain_v", "middle_strain_v", "speed_v"]
    return control.ss(A, B, C, np.zeros((4, 1)), DT_S, inputs=["command_v"], outputs=outputs)


def square_wave(samples: int, seed: int, half_period: tuple[int, int] = (20, 200)) -> Array:
    rng = np.random.default_rng(seed)
    u, k, level = np.empty((samples, 1)), 0, 2.0
    while k < samples:
        width = int(rng.integers(*half_period))
        u[k : k + width] = level
        k, level = k + width, -level
    return u

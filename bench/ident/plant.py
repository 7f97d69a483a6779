"""Synthetic arm of the identification benchmark: records whose truth is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import control
import numpy as np
from scipy import linalg, signal

from flexarm_ident.models.state_space import simulate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

DT_S = 1.0 / 300.0
NOISES = ("white", "butterworth", "ar1", "closed_loop")
_MODES_HZ = np.array([4.2, 13.0, 31.0, 62.0])
_DAMPING = np.array([0.03, 0.02, 0.015, 0.012])
# Standard deviation of an output's noise, as a part of the output's own: drawn between these.
_NOISE = (0.001, 0.2)
_CUTOFF_HZ = 50.0
AR1_POLE = 0.9
_FRESH_SAMPLES = 6000
_OUTPUTS = 4


@dataclass(frozen=True, eq=False)
class Trial:
    """A record to identify, and a fresh one without noise to judge by.

    Attributes
    ----------
    u : ndarray, (samples, 1)
        Input.
    y : ndarray, (samples, 4)
        Measured output, from rest.
    fresh_u, truth : ndarray
        Another input, and what the plant answers to it from rest.
    """

    u: Array
    y: Array
    fresh_u: Array
    truth: Array


def trial(samples: int, noise: str, seed: int) -> Trial:
    """Return one trial of a length in samples, and the truth.

    Noise is 'white', on the outputs; 'butterworth', outputs with white noise behind a 50 Hz
    low-pass filter, which then belongs to the truth; 'ar1', with a pole at 0.9; or 'closed_loop',
    white noise that a controller feeds back to the input: up to two fifths of the signal.
    """
    rng = np.random.default_rng(seed)
    model = plant(rng)
    u, fresh_u = _telegraph(samples, rng), _telegraph(_FRESH_SAMPLES, rng)
    clean, truth = simulate(model, u), simulate(model, fresh_u)
    if noise == "closed_loop":
        return Trial(*_closed_loop(model, u, rng), fresh_u, truth)
    disturbance = rng.normal(size=clean.shape)
    if noise == "ar1":
        disturbance = signal.lfilter([1.0], [1.0, -AR1_POLE], disturbance, axis=0)
        disturbance *= np.sqrt(1.0 - AR1_POLE**2)
    part = _noise_parts(rng)
    y = clean + part * clean.std(axis=0) * disturbance
    if noise == "butterworth":
        b, a = signal.butter(2, _CUTOFF_HZ, fs=1.0 / DT_S)
        y, truth = signal.lfilter(b, a, y, axis=0), signal.lfilter(b, a, truth, axis=0)
    return Trial(u, y, fresh_u, truth)


def plant(rng: np.random.Generator) -> control.StateSpace:
    """Return an arm of order 10: a slow rigid body and four lightly damped modes."""
    rigid = np.array([[0.9995, DT_S], [0.0, 0.985]])
    blocks, gains = [rigid], [np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.8]])]
    frequencies_hz = _MODES_HZ * rng.uniform(0.9, 1.1, len(_MODES_HZ))
    for hz, damping in zip(frequencies_hz, _DAMPING * rng.uniform(0.7, 1.4, 4), strict=True):
        rate = 2.0 * np.pi * hz * complex(-damping, np.sqrt(1.0 - damping**2))
        pole = np.exp(rate * DT_S)
        blocks.append(np.array([[pole.real, pole.imag], [-pole.imag, pole.real]]))
        size = np.array([0.01, 0.5, 0.4, 0.2]) * rng.choice([-1.0, 1.0], 4)
        gains.append(np.outer(size * rng.uniform(0.5, 1.5, 4), [1.0, 0.3]))
    B = np.concatenate([[0.0, 1.0], *(rng.uniform(0.3, 1.0, 2) for _ in _MODES_HZ)])[:, np.newaxis]
    return control.ss(linalg.block_diag(*blocks), B, np.hstack(gains), np.zeros((4, 1)), DT_S)


def error(model: tuple[Array, Array, Array, Array], given: Trial) -> float:
    """Return the geometric mean of the outputs' relative errors; infinite on overflow."""
    missed = simulate(control.ss(*model, DT_S), given.fresh_u) - given.truth
    with np.errstate(over="ignore", invalid="ignore"):
        relative = np.linalg.norm(missed, axis=0) / np.linalg.norm(given.truth, axis=0)
    return float(np.exp(np.mean(np.log(relative)))) if np.all(np.isfinite(relative)) else np.inf


def _noise_parts(rng: np.random.Generator) -> Array:
    low, high = np.log(_NOISE)
    return np.asarray(np.exp(rng.uniform(low, high, _OUTPUTS)))


def _closed_loop(
    model: control.StateSpace, reference: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return input and measured output under a linear-quadratic controller with an observer."""
    A, B, C = model.A, model.B, model.C
    noise, cost = np.eye(_OUTPUTS), np.eye(1)
    P = linalg.solve_discrete_are(A, B, C.T @ C / np.max(np.sum(C**2, axis=1)), cost)
    S = linalg.solve_discrete_are(A.T, C.T, B @ B.T, noise)
    K = np.linalg.solve(cost + B.T @ P @ B, B.T @ P @ A)
    L = A @ S @ C.T @ np.linalg.inv(C @ S @ C.T + noise)
    # States of the plant and of the observer; inputs are the reference and the outputs' noise,
    # outputs those of the plant without noise and the plant's input.
    loop = control.ss(
        np.block([[A, -B @ K], [L @ C, A - B @ K - L @ C]]),
        np.block([[B, np.zeros((len(A), _OUTPUTS))], [B, L]]),
        linalg.block_diag(C, -K),
        np.vstack([np.zeros((_OUTPUTS, 1 + _OUTPUTS)), np.eye(1, 1 + _OUTPUTS)]),
        DT_S,
    )
    still = np.zeros((len(reference), _OUTPUTS))
    clean = simulate(loop, np.hstack([reference, still]))[:, :_OUTPUTS]
    disturbance = _noise_parts(rng) * clean.std(axis=0) * rng.normal(size=clean.shape)
    signals = simulate(loop, np.hstack([reference, disturbance]))
    return signals[:, _OUTPUTS:], signals[:, :_OUTPUTS] + disturbance


def _telegraph(samples: int, rng: np.random.Generator) -> Array:
    """Return a square wave with half periods of 5 to 150 samples."""
    widths = rng.integers(5, 150, samples // 5 + 1)
    edges = np.zeros(samples, dtype=int)
    switches = np.cumsum(widths)
    edges[switches[switches < samples]] = 1
    return np.asarray(2.0 * (-1.0) ** np.cumsum(edges))[:, np.newaxis]

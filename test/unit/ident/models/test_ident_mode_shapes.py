"""Tests of mode shapes, against the eigenvectors of chains of masses and springs."""

from __future__ import annotations

import numpy as np
import scipy
from hypothesis import given
from hypothesis import strategies as st

from flexarm_ident.models.modes import mode_shapes
from support.ident_systems import DT_S, arm_model, named

_SEEDS = st.integers(0, 2**32 - 1)


@given(seed=_SEEDS, masses=st.integers(2, 4), damping=st.floats(0.0, 0.05))
def test_mode_shapes__chain_of_masses___are_its_eigenvectors(
    seed: int, masses: int, damping: float
) -> None:
    rng = np.random.default_rng(seed)
    mass, springs = rng.uniform(0.5, 2.0, masses), rng.uniform(0.5, 2.0, masses + 1) * 4e3
    K = np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1)
    squares, vectors = scipy.linalg.eigh(K, np.diag(mass))
    omega = np.sqrt(squares)
    # Modal damping, the same ratio in each mode.
    D = np.diag(mass) @ vectors @ np.diag(2.0 * damping * omega) @ vectors.T @ np.diag(mass)
    one, zero = np.eye(masses), np.zeros((masses, masses))
    rates = np.block([[zero, one], [-K / mass[:, None], -D / mass[:, None]]])
    change = rng.normal(size=(2 * masses, 2 * masses)) + 3.0 * np.eye(2 * masses)
    A = change @ scipy.linalg.expm(rates * DT_S) @ np.linalg.inv(change)
    B, C = rng.normal(size=(2 * masses, 1)), np.asarray(np.linalg.inv(change), dtype=np.float64)
    model = named(A, B, C, np.zeros((2 * masses, 1)))
    # Of the positions alone: one velocity in each is a thousandth.
    scale = np.repeat([1.0, 1e-3], masses)
    found = mode_shapes(model, scale)
    assert len(found) == masses
    for shape, w, vector in zip(found, omega, vectors.T, strict=True):
        assert np.isclose(shape.frequency_hz, w / (2.0 * np.pi), rtol=1e-6)
        assert np.isclose(shape.damping_ratio, damping, atol=1e-6)
        expected = vector / vector[np.argmax(np.abs(vector))]
        positions, velocities = np.split(shape.values, 2)
        own = positions / positions[np.argmax(np.abs(vector))]
        np.testing.assert_allclose(own, expected, atol=1e-5)
        rate = w * complex(-damping, np.sqrt(1.0 - damping**2))
        np.testing.assert_allclose(velocities, 1e-3 * rate * positions, atol=1e-5)


def test_mode_shapes__undamped_chain___has_speeds_a_quarter_period_ahead() -> None:
    rates = np.array([[0.0, 1.0], [-900.0, 0.0]])
    model = named(scipy.linalg.expm(rates * DT_S), np.ones((2, 1)), np.eye(2), np.zeros((2, 1)))
    (shape,) = mode_shapes(model, np.array([1.0, 1e-3]))
    np.testing.assert_allclose(shape.phase_deg, [0.0, 90.0], atol=1e-6)
    np.testing.assert_allclose(shape.magnitude, [1.0, 0.03], atol=1e-9)


def test_mode_shapes__arm___are_those_of_its_oscillating_modes_only() -> None:
    found = mode_shapes(arm_model(), np.ones(4))
    frequencies = [shape.frequency_hz for shape in found]
    assert frequencies == sorted(frequencies)
    assert min(frequencies) > 0.0
    for shape in found:
        assert np.isclose(np.max(shape.magnitude), 1.0)


def test_mode_shapes__mode_that_no_output_shows___has_none() -> None:
    A = scipy.linalg.block_diag(
        np.array([[0.9, 0.2], [-0.2, 0.9]]), np.array([[0.5, 0.6], [-0.6, 0.5]])
    )
    C = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
    found = mode_shapes(named(A, np.ones((4, 1)), C, np.zeros((2, 1))), np.ones(2))
    assert len(found) == 1
    assert np.isclose(found[0].magnitude[1], 1.0)

from __future__ import annotations

import numpy as np
import pytest

from flexarm_ident.models.modes import (
    frequency_and_damping,
    modal_form,
    modal_response,
    modal_response_magnitudes,
    mode_singular_values,
    ranked_modes,
)
from flexarm_ident.models.state_space import Way, is_stable, stabilise
from support.ident_systems import DT_S, arm_model, named, random_model, record, step_by_step


@pytest.mark.parametrize("hz", [0.5, 9.4, 45.6])
@pytest.mark.parametrize("zeta", [0.005, 0.04, 0.7])
def test_frequency_and_damping___discretised_second_order_system___closed_form(
    hz: float, zeta: float
) -> None:
    omega = 2.0 * np.pi * hz
    lam = np.exp((-omega * zeta + 1j * omega * np.sqrt(1.0 - zeta**2)) * DT_S)
    assert frequency_and_damping(complex(lam), DT_S) == pytest.approx((hz, zeta), rel=1e-10)


@pytest.mark.parametrize(
    ("eigenvalue", "expected"),
    [
        (0.9, (0.0, 1.0)),
        (1.0, (0.0, 1.0)),
        (1.0 - 1e-15, (0.0, 1.0)),
        (1.0 + 1e-15, (0.0, 1.0)),
        (1.0 + 5e-8, (0.0, 1.0)),
        (1.1, (0.0, -1.0)),
        (0.0, (0.0, 1.0)),
        (-4e-16, (0.0, 1.0)),
        (-1.0, (150.0, 0.0)),
    ],
)
def test_frequency_and_damping___real_eigenvalue___as_documented(
    eigenvalue: float, expected: tuple[float, float]
) -> None:
    assert frequency_and_damping(eigenvalue, DT_S) == pytest.approx(expected, abs=1e-12)


def test_modal_form___random_model___is_diagonal_with_pairs_grouped() -> None:
    model = random_model(1, states=7)
    form = modal_form(model)
    psi = form.vectors
    np.testing.assert_allclose(model.A @ psi, psi * form.eigenvalues, atol=1e-12)
    np.testing.assert_allclose(psi @ form.B, model.B, atol=1e-12)
    np.testing.assert_allclose(form.C, model.C @ psi, atol=1e-12)
    assert form.groups == [(0, 1), (2, 3), (4, 5), (6,)]
    for upper, lower in form.groups[:3]:
        assert form.eigenvalues[lower] == form.eigenvalues[upper].conjugate()
        np.testing.assert_array_equal(form.B[lower], form.B[upper].conj())
        np.testing.assert_array_equal(psi[:, lower], psi[:, upper].conj())
    hz = [frequency_and_damping(form.eigenvalues[g[0]], DT_S)[0] for g in form.groups[:3]]
    assert hz == sorted(hz, reverse=True)


def test_modal_response___all_modes___add_up_to_the_response() -> None:
    model = random_model(2, states=7)
    u = np.random.default_rng(1).normal(size=(300, 2))
    form = modal_form(model)
    total = np.sum([modal_response(form, group, u) for group in form.groups], axis=0)
    np.testing.assert_allclose(total, step_by_step(model, u), atol=1e-10)


def test_modal_response_magnitudes___brute_force___maximum_of_mean_magnitudes() -> None:
    model = random_model(3, states=5)
    records = [record(model, 200, seed=1), record(model, 100, seed=2)]
    scale = np.array([1.0, 5.0, 0.1])
    form = modal_form(model)
    expected = []
    for group in form.groups:
        rows = []
        for data in records:
            eta = np.zeros(len(group), dtype=complex)
            for u in data.u:
                rows.append(np.abs((form.C[:, group] @ eta).real))
                eta = form.eigenvalues[list(group)] * eta + form.B[list(group)] @ u
        expected.append(np.max(np.mean(rows, axis=0) * scale))
    np.testing.assert_allclose(modal_response_magnitudes(form, records, scale), expected, rtol=1e-9)


def test_mode_singular_values___brute_force___sum_written_out() -> None:
    model = random_model(4, states=5)
    form, scale = modal_form(model), np.array([1.0, 5.0, 0.1])
    expected = [
        np.sqrt(
            np.linalg.norm(form.C[:, g[0]] * scale)
            * sum(abs(form.eigenvalues[g[0]]) ** k for k in range(49))
            * np.linalg.norm(form.B[g[0]])
        )
        for g in form.groups
    ]
    np.testing.assert_allclose(mode_singular_values(form, 50, scale), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("radius", "total"), [(1.0, 99_999.0), (0.0, 1.0), (1.0 + 1e-6, np.expm1(99_999e-6) / 1e-6)]
)
def test_mode_singular_values___radius_at_or_near_one___closed_form(
    radius: float, total: float
) -> None:
    model = named(np.array([[radius]]), np.eye(1), np.eye(1), np.zeros((1, 1)))
    msv = mode_singular_values(modal_form(model), 100_000, np.ones(1))
    np.testing.assert_allclose(msv, np.sqrt(total), rtol=1e-6)


def test_mode_singular_values___unstable_mode___finite() -> None:
    model = named(np.diag([1.5, 0.5]), np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)))
    msv = mode_singular_values(modal_form(model), 1_000_000, np.ones(1))
    assert np.all(np.isfinite(msv))
    assert msv[1] > msv[0]


def test_ranked_modes___arm___frequencies_damping_ranks_and_labels() -> None:
    data = record(arm_model(), 500, seed=5)
    modes = ranked_modes(arm_model(), [data], np.ones(4))
    pairs = [mode for mode in modes if mode.is_pair]
    assert [mode.frequency_hz for mode in pairs] == pytest.approx([45.6, 24.1, 9.4])
    assert [mode.damping_ratio for mode in pairs] == pytest.approx([0.02, 0.03, 0.04])
    assert [mode.label for mode in modes] == ["1/2", "3/4", "5/6", "7", "8", "9"]
    for index, rank in (("msv", "msv_rank"), ("mrm", "mrm_rank")):
        ranked = sorted(modes, key=lambda mode, index=index: -getattr(mode, index))  # type: ignore[misc]
        assert [getattr(mode, rank) for mode in ranked] == list(range(1, 7))


def test_stabilise___thesis_example___goes_to_0_9999_and_keeps_the_rest() -> None:
    T = np.random.default_rng(6).normal(size=(4, 4))
    block = 1.2 * np.array([[np.cos(1.0), np.sin(1.0)], [-np.sin(1.0), np.cos(1.0)]])
    A = np.zeros((4, 4))
    A[:2, :2], A[2, 2], A[3, 3] = block, 1.0000235, 0.5
    stable, moved = stabilise(T @ A @ np.linalg.inv(T))
    assert moved == 3
    assert is_stable(stable)
    found = np.linalg.eigvals(stable)
    for expected in (0.9999, 0.5, np.exp(1j) / 1.2, np.exp(-1j) / 1.2):
        assert np.abs(found - expected).min() < 1e-9


def unstable(T: np.ndarray) -> np.ndarray:
    """A pair of magnitude 1.0003, and real eigenvalues 1.0004 and 1.001."""
    A = np.zeros((4, 4))
    A[:2, :2] = 1.0003 * np.array([[np.cos(0.2), np.sin(0.2)], [-np.sin(0.2), np.cos(0.2)]])
    A[2, 2], A[3, 3] = 1.0004, 1.001
    return np.asarray(T @ A @ np.linalg.inv(T))


@pytest.mark.parametrize(
    ("way", "pair", "near", "far"),
    [
        ("mirror", 1.0 / 1.0003, 1.0 / 1.0004, 1.0 / 1.001),
        ("clamp", 0.9999, 0.9999, 0.9999),
        ("integrator", 0.9999, 1.0 - 1e-8, 0.9999),
    ],
)
def test_stabilise___each_way___has_its_magnitudes(
    way: Way, pair: float, near: float, far: float
) -> None:
    stable, moved = stabilise(unstable(np.random.default_rng(8).normal(size=(4, 4))), way)
    assert moved == 4
    assert is_stable(stable)
    found = np.linalg.eigvals(stable)
    for expected in (pair * np.exp(0.2j), near, far):
        assert np.abs(found - expected).min() < 1e-6


def test_stabilise___two_that_come_to_the_same_place___keep_their_modes() -> None:
    T = np.random.default_rng(8).normal(size=(4, 4))
    stable, _ = stabilise(unstable(T), "clamp")
    # The last two columns are the directions of 1.0004 and 1.001.
    for column, radius in ((T[:, 3], 0.9999), (T[:, 2], 0.9999 * (1.0 - 1e-6))):
        np.testing.assert_allclose(stable @ column, radius * column, rtol=0.0, atol=1e-11)
    values, vectors = np.linalg.eig(stable)
    for column in (T[:, 2], T[:, 3]):
        along = np.abs(vectors.conj().T @ column) / np.linalg.norm(column)
        assert along[np.isclose(values, 0.9999, atol=1e-5)].max() == pytest.approx(1.0, abs=1e-8)


def test_stabilise___stable_matrix___is_returned_as_it_is() -> None:
    A = random_model(7).A
    stable, moved = stabilise(A)
    assert moved == 0
    np.testing.assert_array_equal(stable, A)


def test_stabilise___defective_unstable_matrix___ends_up_stable() -> None:
    stable, moved = stabilise(np.array([[1.01, 1.0], [0.0, 1.01]]))
    assert moved == 2
    assert is_stable(stable)

"""Ways to move an unstable eigenvalue, chosen by simulation error."""

from dataclasses import replace

import control
import numpy as np
import pytest

from flexarm_ident import IoData
from flexarm_ident.fitting.output_fit import fit_each, fit_inputs
from flexarm_ident.fitting.stable_fit import fit_stable
from flexarm_ident.models.state_space import WAYS, moved, spectrum

RATE_HZ = 300.0


def record(A: np.ndarray, samples: int = 3000) -> tuple[np.ndarray, IoData]:
    """Return C, and a record of a model with the state matrix."""
    rng = np.random.default_rng(4)
    C = rng.normal(size=(2, len(A)))
    model = control.ss(A, rng.normal(size=(len(A), 1)), C, 0.0, 1.0 / RATE_HZ)
    u = np.repeat(rng.choice(np.array([-1.0, 1.0]), samples // 30), 30)
    y = control.forced_response(model, inputs=u).outputs.T
    return C, IoData(u, y, dt_s=1.0 / RATE_HZ, inputs=("u",), outputs=("a", "b"))


@pytest.mark.parametrize(
    ("truth", "estimate", "way", "radius"),
    [
        (1.0, 1.0003, "integrator", 1.0 - 1e-8),
        (0.997, 1.003, "mirror", 1.0 / 1.003),
        (0.9999, 1.005, "clamp", 0.9999),
    ],
)
def test_fit_stable___slow_state___goes_where_the_record_says(
    truth: float, estimate: float, way: str, radius: float
) -> None:
    C, data = record(np.diag([truth, 0.9]))
    found = fit_stable(
        np.diag([estimate, 0.9]), C, [data], WAYS, feedthrough=False, noise_weighted=False
    )
    assert (found.way, found.unstable) == (way, 1)
    assert found.A[0, 0] == pytest.approx(radius, abs=1e-12)
    assert found.fit.error.max() < 0.05


def test_fit_stable___slow_pair_of_a_hub_with_drag___is_integrator_and_drag() -> None:
    # Position and speed, of which an estimate sees a weak spring that is not there.
    drag, step, spring = 0.9997, 0.01, 1.2e-5
    A = np.array([[1.0, step, 0.0], [0.0, drag, 0.0], [0.0, 0.0, 0.9]])
    C, data = record(A, samples=6000)
    estimate = A.copy()
    estimate[1, 0] = -spring
    assert np.iscomplex(np.linalg.eigvals(estimate)).sum() == 2

    found = fit_stable(estimate, C, [data], WAYS, feedthrough=False, noise_weighted=False)

    assert (found.way, found.unstable) == ("drag", 0)
    slow = np.sort(np.linalg.eigvals(found.A).real)[1:]
    np.testing.assert_allclose(slow, [drag, 1.0], rtol=0.0, atol=1e-7)
    others = fit_stable(estimate, C, [data], WAYS[:3], feedthrough=False, noise_weighted=False)
    assert found.fit.error.max() < 0.25 * others.fit.error.max()


def test_moved___two_real_eigenvalues_near_1___keep_their_sum() -> None:
    found = moved(spectrum(np.diag([0.99988, 0.5, 0.99981])), "drag")

    values = np.sort(np.linalg.eigvals(found.A).real)
    np.testing.assert_allclose(values, [0.5, 0.99969, 1.0], rtol=0.0, atol=3e-8)


def test_moved___sum_that_leaves_no_drag___is_moved_as_an_integrator() -> None:
    pair = np.array([[1.0001, 0.0003], [-0.0003, 1.0001]])

    np.testing.assert_allclose(
        moved(spectrum(pair), "drag").A, moved(spectrum(pair), "integrator").A, rtol=0.0, atol=1e-12
    )


def test_fit_stable___stable_matrix_or_no_way___stays() -> None:
    C, data = record(np.diag([0.99, 0.9]))
    for A, ways in ((np.diag([0.99, 0.9]), WAYS), (np.diag([1.0001, 0.9]), ())):
        found = fit_stable(A, C, [data], ways, feedthrough=False, noise_weighted=False)
        assert (found.way, found.unstable) == (None, 0)
        np.testing.assert_array_equal(found.A, A)


@pytest.mark.filterwarnings("error")
def test_fit_stable___growth_within_a_short_record___does_not_overflow_after_its_end() -> None:
    A = np.diag([1.5, 0.9])
    C, data = record(A, samples=200)

    found = fit_stable(A, C, [data], (), feedthrough=False, noise_weighted=False)

    assert found.fit.error.max() < 1e-6


@pytest.mark.parametrize("feedthrough", [False, True])
def test_fit_each___ways_of_one_matrix___are_fitted_as_each_alone(*, feedthrough: bool) -> None:
    rng = np.random.default_rng(5)
    # A growing decay, a growing vibration, and what stays: a decay and a vibration.
    A = np.diag([1.0002, 0.0, 0.0, 0.97, 0.0, 0.0])
    for first, radius, angle in ((1, 1.004, 0.3), (4, 0.8, 0.6)):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        A[first : first + 2, first : first + 2] = radius * turn
    T = rng.normal(size=A.shape)
    A = np.asarray(np.linalg.solve(T, A @ T))
    C, data = record(moved(spectrum(A), "mirror").A)
    data = replace(data, y=data.y + 0.05 * data.y.std(axis=0) * rng.normal(size=data.y.shape))
    spectra = [moved(spectrum(A), way) for way in WAYS]
    fits = fit_each(spectra, C, [data], feedthrough=feedthrough, noise_weighted=True, at_rest=False)
    for each, fit in zip(spectra, fits, strict=True):
        alone = fit_inputs(each.A, C, [data], feedthrough=feedthrough, noise_weighted=True)
        size = np.abs(alone.B).max()
        np.testing.assert_allclose(fit.B, alone.B, rtol=1e-6, atol=1e-6 * size)
        np.testing.assert_allclose(fit.D, alone.D, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(fit.error, alone.error, rtol=1e-8)

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from flexarm_ident import IoData, identify
from flexarm_ident.fitting.validation import validate_dmv
from support.ident_systems import DT_S, arm_model, random_model, record, square_wave, step_by_step

SAMPLES = 4000
ORDER = 9


def noisy_arm(seed: int, noise: float) -> IoData:
    """Return the arm under a square wave with white noise, a part of each output's deviation."""
    rng = np.random.default_rng(seed)
    u = square_wave(SAMPLES, seed)
    y = step_by_step(arm_model(), u)
    return IoData(u, y + noise * y.std(axis=0) * rng.normal(size=y.shape), dt_s=DT_S)


@pytest.mark.parametrize("seed", range(3))
def test_cross_validation___each_fifth_left_out_by_hand___same_errors(seed: int) -> None:
    data = noisy_arm(seed, 0.3)
    found = identify(data, order=ORDER, block_rows=20, method="orse").cross_validation
    assert found is not None
    edges = np.linspace(0, SAMPLES, 6).astype(int)
    simulated = np.empty_like(data.y)
    for first, last in pairwise(edges):
        pieces = [
            data.rows(slice(low, high)) for low, high in ((0, first), (last, SAMPLES)) if high > low
        ]
        model = identify(pieces, order=ORDER, block_rows=20, method="orse").model
        simulated[first:last] = validate_dmv(model, data).y[first:last]
    by_hand = np.sqrt(np.mean((data.y - simulated) ** 2, axis=0)) / data.y.std(axis=0)
    # The blocks of the product lack the samples that columns before them reach.
    np.testing.assert_allclose(found.error, by_hand, rtol=0.03)


def test_cross_validation___white_noise___error_is_the_share_of_the_noise() -> None:
    noise = 0.4
    found = identify(
        noisy_arm(1, noise), order=ORDER, block_rows=20, method="orse"
    ).cross_validation
    assert found is not None
    clean = step_by_step(arm_model(), square_wave(SAMPLES, 1))
    share = noise * clean.std(axis=0)
    expected = share / np.sqrt(clean.var(axis=0) + share**2)
    np.testing.assert_allclose(found.error, expected, rtol=0.1)


def test_cross_validation___outputs_of_noise_alone___shows_what_the_fit_hides() -> None:
    rng = np.random.default_rng(0)
    data = IoData(rng.normal(size=(600, 1)), rng.normal(size=(600, 1)), dt_s=DT_S, outputs=("y",))
    found = identify(data, order=14, block_rows=15, method="orse")
    assert found.cross_validation is not None
    assert found.fit_error[0] < 0.98
    assert found.cross_validation.error[0] > 1.0


def test_cross_validation___few_samples___is_left_out() -> None:
    data = record(random_model(0, 2, 1, 1), 90, seed=0)
    assert identify(data, order=2, block_rows=25, method="orse").cross_validation is None


@pytest.mark.parametrize("method", ["orse_iv", "pbsid"])
@pytest.mark.slow
def test_diagnostics___single_step_without_noise___have_no_figures_instead_of_an_error(
    method: str,
) -> None:
    u = np.zeros((2000, 1))
    u[300:] = 1.0
    found = identify(IoData(u, step_by_step(arm_model(), u), dt_s=DT_S), method=method)
    # Without the segment of the step, nothing moves.
    assert len(found.mode_uncertainty) in (0, len(found.modes))
    assert found.cross_validation is None or np.isfinite(found.cross_validation.error).all()

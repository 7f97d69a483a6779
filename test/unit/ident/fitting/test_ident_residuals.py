from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from flexarm_ident import IoData
from flexarm_ident.fitting.residuals import LAGS, residual_correlations
from flexarm_ident.fitting.validation import fit_percent
from support.ident_systems import DT_S

SAMPLES = 20_000


def record(y: np.ndarray, u: np.ndarray) -> IoData:
    return IoData(u, y, dt_s=DT_S, inputs=("u",), outputs=("y",))


def test_residual_correlations___white_residual___stays_within_the_bounds() -> None:
    rng = np.random.default_rng(1)
    u = signal.lfilter([1.0], [1.0, -0.95], rng.normal(size=SAMPLES))
    found = residual_correlations([record(rng.normal(size=SAMPLES), u)], [np.zeros((SAMPLES, 1))])
    assert found.own_bound == pytest.approx(2.576 / np.sqrt(SAMPLES), rel=1e-3)
    assert found.is_white[0] > 0.9
    assert found.is_independent[0, 0] > 0.9
    assert len(found.lags) == 2 * LAGS + 1


def test_residual_correlations___first_order_noise___has_its_powers() -> None:
    rng = np.random.default_rng(2)
    v = signal.lfilter([1.0], [1.0, -0.8], rng.normal(size=SAMPLES))
    found = residual_correlations([record(v, rng.normal(size=SAMPLES))], [np.zeros((SAMPLES, 1))])
    np.testing.assert_allclose(found.own[:8, 0], 0.8 ** np.arange(1, 9), atol=0.05)
    assert found.is_white[0] < 0.9
    # Its colour does not widen the bound beside a white input.
    assert found.cross_bound[0, 0] == pytest.approx(found.own_bound, rel=0.1)


def test_residual_correlations___two_coloured_signals___have_bartletts_bound() -> None:
    rng = np.random.default_rng(3)
    u, v = (signal.lfilter([1.0], [1.0, -0.9], rng.normal(size=SAMPLES)) for _ in range(2))
    found = residual_correlations([record(v, u)], [np.zeros((SAMPLES, 1))])
    expected = np.sqrt((1.0 + 0.81) / (1.0 - 0.81))
    assert found.cross_bound[0, 0] / found.own_bound == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("lag", [3, -7])
def test_residual_correlations___missing_answer_at_one_lag___stands_there(lag: int) -> None:
    rng = np.random.default_rng(4)
    u = rng.normal(size=SAMPLES)
    y = np.roll(u, lag) + rng.normal(size=SAMPLES)
    halves = [record(y[rows], u[rows]) for rows in (slice(0, 9000), slice(9000, None))]
    found = residual_correlations(halves, [np.zeros((9000, 1)), np.zeros((SAMPLES - 9000, 1))])
    largest = int(np.argmax(np.abs(found.cross[:, 0, 0])))
    assert found.lags[largest] == lag
    assert found.cross[largest, 0, 0] == pytest.approx(np.sqrt(0.5), abs=0.02)


def test_residual_correlations___hole_and_simulation_that_runs_away___do_not_count() -> None:
    rng = np.random.default_rng(5)
    y, u = rng.normal(size=SAMPLES), rng.normal(size=SAMPLES)
    y[500:900] = np.nan
    wild = np.zeros((SAMPLES, 1))
    wild[-100:] = np.inf
    found = residual_correlations([record(y, u)], [wild])
    assert np.all(np.isfinite(found.own))
    assert found.is_white[0] > 0.9


def test_fit_percent___offset_and_scaled_output___are_those_of_the_definition() -> None:
    y = 5.0 + np.array([[1.0], [-1.0], [1.0], [-1.0]])
    assert fit_percent(y, y)[0] == pytest.approx(100.0)
    assert fit_percent(y, np.full_like(y, 5.0))[0] == pytest.approx(0.0)
    assert fit_percent(y, 5.0 + 0.75 * (y - 5.0))[0] == pytest.approx(75.0)
    hole = y.copy()
    hole[1] = np.nan
    hole[0] = np.nan
    assert fit_percent(hole, y)[0] == pytest.approx(100.0)


def test_fit_percent___constant_output_and_wild_simulation___have_none() -> None:
    y = np.column_stack([np.full(4, 3.0), np.arange(4.0)])
    fit = fit_percent(y, np.column_stack([np.zeros(4), np.full(4, np.inf)]))
    assert np.isnan(fit[0])
    assert fit[1] == -np.inf

"""Choice by `method="auto"`, and the tests that it uses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from flexarm_ident import IoData, identify
from flexarm_ident.subspace.feedback import feedback_test, reaches_inputs
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.methods import select_method, whiteness_test
from flexarm_ident.subspace.orse import innovation_scaled
from support.ident_systems import DT_S, arm_model, random_model, record, square_wave, step_by_step

Q, COLUMNS = 20, 4000


def noise_only(seed: int, pole: float = 0.0) -> IoData:
    """Return outputs that are noise and have nothing to do with the input."""
    rng = np.random.default_rng(seed)
    samples = COLUMNS + Q - 1
    y = signal.lfilter([1.0], [1.0, -pole], rng.normal(size=(samples, 3)), axis=0)
    return IoData(rng.normal(size=(samples, 1)), y, dt_s=DT_S, inputs=("u",), outputs=tuple("abc"))


def arm_record(seed: int, *, noise: float = 0.02, pole: float = 0.0) -> IoData:
    u = square_wave(4000, seed)
    y = step_by_step(arm_model(), u)
    disturbance = np.random.default_rng(seed).normal(size=y.shape)
    disturbance = signal.lfilter([1.0], [1.0, -pole], disturbance, axis=0)
    return IoData(u, y + noise * y.std(axis=0) * disturbance, dt_s=DT_S)


def test_whiteness_test___white_noise___spread_has_the_stated_mean_and_deviation() -> None:
    spreads = []
    for seed in range(60):
        space = innovation_scaled(block_gram([noise_only(seed)], Q))
        found = whiteness_test(space, COLUMNS, 0)
        assert found.expected == pytest.approx(3 * Q / COLUMNS)
        assert found.white
        spreads.append(found.spread)
    deviation = np.sqrt(8.0 * Q / 3.0) / COLUMNS
    # The input's regression costs Q of the columns; scaling takes the differences of the levels.
    assert np.mean(spreads) == pytest.approx(3 * Q / COLUMNS, abs=deviation)
    assert np.std(spreads) == pytest.approx(deviation, rel=0.35)


@pytest.mark.parametrize("pole", [-0.4, 0.4, 0.9])
def test_whiteness_test___coloured_noise___spread_is_that_of_its_spectrum(pole: float) -> None:
    space = innovation_scaled(block_gram([noise_only(1, pole)], Q))
    found = whiteness_test(space, COLUMNS, 0)
    covariance = pole ** np.abs(np.subtract.outer(np.arange(Q), np.arange(Q)))
    values = np.linalg.eigvalsh(covariance)
    assert found.spread == pytest.approx(values.var() / values.mean() ** 2, rel=0.2)
    assert not found.white


def test_whiteness_test___no_noise___passes() -> None:
    data = record(random_model(1), 1000, seed=1)
    found = whiteness_test(innovation_scaled(block_gram([data], 10)), 991, 5)
    assert found.white
    assert found.spread == 0.0


def test_reaches_inputs___statistic___is_that_of_the_feedback_test() -> None:
    for seed, gain in ((1, 0.0), (2, 0.5)):
        rng = np.random.default_rng(seed)
        noise, y = rng.normal(size=3000), np.zeros(3000)
        u = rng.normal(size=3000)
        for k in range(1, 3000):
            y[k] = 0.8 * y[k - 1] + u[k - 1] + noise[k]
            u[k] -= gain * y[k - 1]
        data = IoData(u[:, np.newaxis], y[:, np.newaxis], dt_s=DT_S, inputs=("u",), outputs=("y",))
        gram = block_gram([data], 20)
        assert reaches_inputs(gram) == (gain > 0.0)
        assert feedback_test([data], gram).detected == (gain > 0.0)


@pytest.mark.parametrize("seed", range(5))
def test_select_method___white_noise___takes_orse_with_a_reason(seed: int) -> None:
    found = select_method([arm_record(seed)], 40, closed_loop=False, order=9)
    assert found.method == "orse"
    assert found.gram.block_rows == 40
    assert found.reason.startswith(
        "orse was chosen: later inputs are not correlated with the outputs' noise, which passes "
        "for white: spread"
    )


@pytest.mark.parametrize("pole", [-0.5, 0.5, 0.9])
def test_select_method___coloured_noise___takes_instruments(pole: float) -> None:
    found = select_method([arm_record(1, pole=pole)], 40, closed_loop=False)
    assert found.method == "orse_iv"
    assert found.gram.block_rows == 80
    assert "orse_iv was chosen: the outputs' noise is coloured: spread" in found.reason


def test_select_method___declared_closed_loop___takes_pbsid() -> None:
    found = select_method([arm_record(1)], 40, closed_loop=True)
    assert found.method == "pbsid"
    assert found.gram.block_rows == 80
    assert found.reason == "pbsid was chosen: closed loop, as declared"


def test_select_method___undeclared_feedback___takes_pbsid() -> None:
    rng = np.random.default_rng(3)
    model, reference = arm_model(), square_wave(4000, 3)[:, 0]
    x, u, y = np.zeros(model.nstates), np.zeros((4000, 1)), np.zeros((4000, 4))
    for k in range(4000):
        y[k] = model.C @ x + 0.5 * rng.normal(size=4)
        u[k] = reference[k] - 0.5 * y[k, 3]
        x = model.A @ x + model.B @ u[k]
    found = select_method([IoData(u, y, dt_s=DT_S)], 40, closed_loop=False)
    assert found.method == "pbsid"
    assert "later inputs are correlated with the outputs' noise" in found.reason


def test_identify___auto___is_the_method_it_names() -> None:
    cases = ((arm_record(2), None), (arm_record(2, pole=0.9), None), (arm_record(2), True))
    for data, closed_loop in cases:
        given = replace(data, closed_loop=closed_loop)
        auto = identify(given, order=9, method="auto")
        named = identify(given, order=9, method=auto.method)
        np.testing.assert_allclose(auto.model.A, named.model.A, atol=1e-9)
        np.testing.assert_allclose(auto.model.B, named.model.B, atol=1e-9)
        assert auto.choice.startswith(f"{auto.method} was chosen: ")
        assert named.choice == ""

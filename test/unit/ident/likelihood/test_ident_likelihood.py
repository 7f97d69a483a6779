"""Maximum likelihood: noise filters, nearer to the truth, honest deviations, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy

from flexarm_ident import IoData, identify
from flexarm_ident.likelihood.maximum_likelihood import maximise_likelihood
from flexarm_ident.likelihood.noise_filter import is_noise, whitening_filter
from flexarm_ident.models.modes import modal_form
from support.ident_systems import (
    DT_S,
    arm_model,
    named,
    pulse_responses,
    random_model,
    record,
    step_by_step,
)

POLE = 0.8


def coloured(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Return noise of unit variance with a pole at 0.8."""
    noise = scipy.signal.lfilter([1.0], [1.0, -POLE], rng.normal(size=shape), axis=0)
    return np.asarray(noise * np.sqrt(1.0 - POLE**2))


def noisy(seed: int, samples: int, part: float = 0.1) -> IoData:
    """Return a record of a fixed system; input and coloured noise depend on the seed."""
    model, rng = random_model(5, 4, 2, 1), np.random.default_rng(seed)
    u = rng.normal(size=(samples, 1))
    y = step_by_step(model, u)
    y = y + part * y.std(axis=0) * coloured(rng, y.shape)
    return IoData(u, y, dt_s=DT_S, inputs=("u0",), outputs=("y0", "y1"))


def test_whitening_filter___known_pole___is_found() -> None:
    e = 3.0 * coloured(np.random.default_rng(0), (20_000,))
    taps = whitening_filter([e])
    assert taps[1] / taps[0] == pytest.approx(-POLE, abs=0.02)
    assert np.convolve(e, taps)[: len(e)].std() == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_whitening_filter___several_records_with_holes___solves_the_normal_equations(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    numerator = np.array([1.0, 0.5, -0.3])
    errors = [np.convolve(rng.normal(size=size), numerator) for size in (900, 700)]
    errors[0][200:230] = np.nan
    taps = whitening_filter(errors)
    order = len(taps) - 1
    filled = [np.nan_to_num(e) for e in errors]
    sums = [sum(e[lag:] @ e[: len(e) - lag] for e in filled) for lag in range(order + 1)]
    by_matrix = scipy.linalg.solve_toeplitz(sums[:order], [-value for value in sums[1:]])
    np.testing.assert_allclose(taps[1:] / taps[0], by_matrix, rtol=1e-6)


def test_is_noise___inputs_with_and_without_effect___are_distinguished() -> None:
    rng = np.random.default_rng(0)
    u, e = rng.normal(size=(4000, 2)), rng.normal(size=(4000, 3))
    assert is_noise([e], [u])
    # What comes after the error is the answer of a controller.
    assert is_noise([e], [u - 0.5 * e[:, :2]])
    late = np.vstack([np.zeros((30, 2)), u[:-30]])
    assert not is_noise([e + 0.2 * late[:, [0]]], [u])


def test_likelihood___coloured_noise___is_nearer_to_the_truth_than_the_subspace_model() -> None:
    known = pulse_responses(random_model(5, 4, 2, 1))
    ratios = []
    for seed in range(6):
        data = noisy(seed, 1500)
        start = identify(data, order=4, block_rows=10, method="orse_iv")
        found = maximise_likelihood(start.model, start.x0, data)
        assert found is not None
        missed = [np.linalg.norm(pulse_responses(each.model) - known) for each in (found, start)]
        ratios.append(missed[0] / missed[1])
    assert np.median(ratios) < 0.9
    assert max(ratios) < 1.2


def test_likelihood___order_left_open___comes_down_to_that_of_the_plant() -> None:
    known = pulse_responses(random_model(5, 4, 2, 1))
    for seed in range(2):
        data = noisy(seed, 3000)
        start = identify(data, order=9, block_rows=10, method="orse_iv")
        given, found = (
            maximise_likelihood(start.model, start.x0, data, order_open=order_open)
            for order_open in (False, True)
        )
        assert given is not None
        assert found is not None
        assert (given.model.nstates, found.model.nstates) == (9, 4)
        assert len(found.modes) == len(modal_form(found.model).groups)
        missed = [np.linalg.norm(pulse_responses(each.model) - known) for each in (found, given)]
        assert missed[0] < 0.8 * missed[1]


def test_identify___refined___keeps_a_given_order_only() -> None:
    data = noisy(0, 3000)
    found = [
        identify(data, order=order, block_rows=10, refine=True, method="orse")
        for order in (9, None)
    ]
    assert [each.order for each in found] == [9, 4]
    assert [each.model.nstates for each in found] == [9, 4]
    assert found[1].notes[-1].startswith("refined by maximum likelihood")


@pytest.mark.slow
@pytest.mark.exhaustive
def test_likelihood___deviations___hold_over_many_records() -> None:
    clean = identify(
        record(random_model(5, 4, 2, 1), 600, 0), order=4, block_rows=10, method="orse"
    )
    truth = sorted(each.frequency_hz for each in clean.modes)
    scores = []
    for seed in range(40):
        found = identify(noisy(seed, 800), order=4, block_rows=10, method="orse_iv", refine=True)
        assert found.likelihood is not None
        modes = sorted(found.mode_uncertainty)
        scores.append(
            [(m.frequency_hz - hz) / m.frequency_std_hz for m, hz in zip(modes, truth, strict=True)]
        )
    # 95 % of 80 scores and three standard deviations of that count.
    assert 70 <= np.sum(np.abs(scores) < 1.96) <= 80
    assert np.std(scores) == pytest.approx(1.0, abs=0.25)


def test_likelihood___hole_in_the_record___is_left_out() -> None:
    data = noisy(3, 1500)
    y = data.y.copy()
    y[500:600] = np.nan
    holed = replace(data, y=y)
    start = identify(holed, order=4, block_rows=10, method="orse")
    found = maximise_likelihood(start.model, start.x0, holed)
    assert found is not None
    # What stands in the hole does not matter.
    y = data.y.copy()
    y[500:600] += 100.0
    filled = replace(data, y=y, missing=np.isnan(holed.y_measured))
    again = maximise_likelihood(start.model, start.x0, filled)
    assert again is not None
    np.testing.assert_allclose(
        pulse_responses(again.model), pulse_responses(found.model), rtol=1e-6, atol=1e-9
    )


def test_likelihood___missing_dynamics___gives_way_to_the_simulation_error() -> None:
    rng = np.random.default_rng(1)
    u = rng.normal(size=(3000, 1))
    y = step_by_step(arm_model(), u)
    data = IoData(u, y + 1e-3 * y.std(axis=0) * rng.normal(size=y.shape), dt_s=DT_S)
    start = identify(data, order=5, block_rows=15, method="orse")
    assert maximise_likelihood(start.model, start.x0, data) is None
    refined = identify(data, order=5, block_rows=15, refine=True, method="orse")
    assert "refined by the simulation error" in refined.notes[-1]
    assert refined.likelihood is None


def test_likelihood___few_samples_or_defective_model___gives_none() -> None:
    short = noisy(0, 200)
    start = identify(short, order=8, block_rows=10, method="orse")
    assert maximise_likelihood(start.model, start.x0, short) is None
    jordan = named(
        np.array([[0.9, 1.0], [0.0, 0.9]]), np.ones((2, 1)), np.ones((2, 2)), np.zeros((2, 1))
    )
    assert maximise_likelihood(jordan, [np.zeros(2)], noisy(0, 2000)) is None

"""Errors in the frequency domain: the same as sample by sample, from few rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexarm_ident import IoData, identify
from flexarm_ident.fitting.modal_error import ModalError
from flexarm_ident.likelihood.maximum_likelihood import maximise_likelihood
from flexarm_ident.likelihood.spectral_error import SpectralError, spectral_bands, whole_length
from flexarm_ident.models.modes import frequency_grid
from flexarm_ident.models.state_space import simulate
from support.ident_systems import random_model, record, step_by_step

FILTERS = [np.array([1.0, -0.7, 0.1])[: output + 1] for output in range(3)]
STARTS = [np.ones(5), -np.ones(5)]


def two_records(lengths: tuple[int, int] = (701, 500)) -> list[IoData]:
    model = random_model(4)
    return [record(model, count, seed, noise=0.1) for seed, count in enumerate(lengths)]


def test_bands___squares_of_rows_and_rest___are_those_of_the_samples() -> None:
    data = two_records()[0]
    poles = np.linalg.eigvals(random_model(4).A).astype(complex)
    bands = spectral_bands(data, poles)
    samples = whole_length(data)
    total = np.sum(np.abs(bands.y) ** 2, axis=(0, 1)) + bands.rest.sum(axis=0)
    np.testing.assert_allclose(total, np.sum(data.y[:samples] ** 2, axis=0), rtol=1e-10)
    assert samples > 0.95 * len(data)


def test_bands___long_record___takes_hardly_more_rows_than_a_short_one() -> None:
    model = random_model(4)
    poles = np.linalg.eigvals(model.A).astype(complex)
    short, long = (spectral_bands(record(model, count, 0), poles) for count in (3000, 30_000))
    assert len(long.nodes) < 1.2 * len(short.nodes)
    assert long.suit(poles)
    assert not long.suit(np.multiply(0.5 + 0.0j, poles))


def test_spectral_error___errors___are_those_of_the_simulation() -> None:
    model, records = random_model(4), two_records()
    problem = SpectralError(model, records, FILTERS)
    errors = problem.errors(problem.start(STARTS))
    for e, data, start in zip(errors, records, STARTS, strict=True):
        wanted = data.y - simulate(model, data.u, start)
        np.testing.assert_allclose(e, wanted[: len(e)], atol=1e-10)


def test_spectral_error___without_filters___has_the_cost_of_the_samples() -> None:
    model, records = random_model(4), two_records((720, 500))
    unfiltered = [np.ones(1)] * 3
    problem = SpectralError(model, records, unfiltered)
    sampled = ModalError(model, records, unfiltered)
    assert problem.cost(problem.start(STARTS)) == pytest.approx(
        sampled.cost(sampled.pack(STARTS)), rel=1e-5
    )


def test_spectral_error___gradient___agrees_with_differences() -> None:
    problem = SpectralError(random_model(4), two_records(), FILTERS)
    theta = problem.start(STARTS)
    theta = theta + 1e-3 * np.random.default_rng(0).normal(size=len(theta))
    normal = problem.normal(theta)
    step = 1e-6 * np.eye(len(theta))
    slopes = np.array([(problem.cost(theta + h) - problem.cost(theta - h)) / 2e-6 for h in step])
    assert normal.cost == pytest.approx(problem.cost(theta), rel=1e-9)
    assert 2.0 * normal.gradient == pytest.approx(slopes, abs=1e-5 * np.abs(slopes).max())


def test_spectral_error___one_mode_less___is_the_model_without_it() -> None:
    problem = SpectralError(random_model(4), two_records(), FILTERS)
    theta = problem.start(STARTS)
    group = problem.groups[0]
    simpler, start = problem.simpler(theta, group)
    whole, less = problem.model(theta), simpler.model(start)
    assert less.nstates == whole.nstates - len(group)
    left = np.linalg.eigvals(less.A)
    assert all(np.abs(np.linalg.eigvals(whole.A) - each).min() < 1e-9 for each in left)


def test_likelihood___hole_of_one_row___changes_the_way_but_not_the_model() -> None:
    data = record(random_model(5, 4, 2, 1), 1500, 1, noise=0.1)
    holed = replace(data, missing=np.arange(1500)[:, np.newaxis] * np.ones(2, int) == 700)
    start = identify(data, order=4, block_rows=10, method="orse")
    by_lines, by_samples = (maximise_likelihood(start.model, start.x0, d) for d in (data, holed))
    assert by_lines is not None
    assert by_samples is not None
    first, second = (sorted(each.modes) for each in (by_lines, by_samples))
    for one, other in zip(first, second, strict=True):
        assert one.frequency_hz == pytest.approx(other.frequency_hz, abs=0.5 * one.frequency_std_hz)
        assert one.frequency_std_hz == pytest.approx(other.frequency_std_hz, rel=0.1)


@pytest.mark.slow
@pytest.mark.exhaustive
def test_likelihood___deviation_of_the_response___is_its_scatter_over_records() -> None:
    model = random_model(5, 4, 2, 1)
    grid = frequency_grid(model, 1.0)[::40]
    responses, deviations = [], []
    for seed in range(40):
        data = record(model, 800, seed, noise=0.1)
        start = identify(data, order=4, block_rows=10, method="orse")
        fit = maximise_likelihood(start.model, start.x0, data)
        assert fit is not None
        found = fit.response_uncertainty(grid)
        responses.append(found.response)
        deviations.append(found.deviation)
    scatter = np.sqrt(np.mean(np.abs(responses - np.mean(responses, axis=0)) ** 2, axis=0))
    ratio = np.mean(deviations, axis=0) / scatter
    # Forty records tell a deviation within some 11 %.
    assert 0.7 < ratio.min() <= ratio.max() < 1.4


def test_auto___errors_that_are_noise___takes_the_likelihood_and_its_left_out_error() -> None:
    data = record(random_model(5, 4, 2, 1), 4000, 3, noise=0.1)
    found = identify(data, block_rows=20)
    assert found.likelihood is not None
    assert found.order == 4
    assert "maximum likelihood" in found.choice
    left_out = found.cross_validation
    assert left_out is not None
    # White noise of a tenth is missed, and hardly more.
    np.testing.assert_allclose(left_out.error, 0.1, rtol=0.05)


@pytest.mark.slow
@pytest.mark.exhaustive
def test_auto___direct_term___is_no_noise_of_a_model_without_it() -> None:
    model = random_model(5, 4, 2, 1, feedthrough=True)
    rng = np.random.default_rng(0)
    u = rng.normal(size=(4000, 1))
    y = step_by_step(model, u)
    data = replace(record(model, 4000, 0), u=u, y=y + 0.05 * rng.normal(size=y.shape))
    assert identify(data, block_rows=20, feedthrough=False).likelihood is None
    assert np.any(identify(data, block_rows=20, feedthrough=None).model.D)

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import control
import numpy as np
import pytest
from scipy import signal

from flexarm_ident import DataError, IoData, identify
from flexarm_ident.diagnostics.uncertainty import (
    frequency_response_uncertainty,
    jackknife,
    mode_uncertainty,
)
from flexarm_ident.fitting.output_fit import fit_inputs
from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.models.modes import ranked_modes
from flexarm_ident.models.state_space import stabilise
from flexarm_ident.records.preprocess import output_scale
from flexarm_ident.subspace.gram import BlockGram, block_gram
from flexarm_ident.subspace.orse import innovation_scaled, past_instruments
from support.exhaustive import first_of
from support.ident_systems import (
    DT_S,
    arm_model,
    pulse_responses,
    random_model,
    record,
    square_wave,
    step_by_step,
)

if TYPE_CHECKING:
    from flexarm_ident.subspace.subspace_protocol import StateMatrices

PAST = 12
FREQUENCIES_HZ = np.array([2.0, 5.0, 9.4, 15.0, 24.1, 40.0, 70.0])
ARM_HZ = np.array([45.6, 24.1, 9.4])


def white(gram: BlockGram) -> StateMatrices:
    return innovation_scaled(gram).matrices(9)


def coloured(gram: BlockGram) -> StateMatrices:
    return past_instruments(gram).matrices(9)


def arm_data(seed: int, *, colour: bool) -> IoData:
    """Return the arm under one input, whatever the seed of its noise."""
    rng = np.random.default_rng(seed)
    u = square_wave(3000, 5)
    y = step_by_step(arm_model(), u)
    noise = rng.normal(size=y.shape)
    if colour:
        noise = np.sqrt(1.0 - 0.9**2) * signal.lfilter([1.0], [1.0, -0.9], noise, axis=0)
    return IoData(u, y + 0.05 * y.std(axis=0) * noise, dt_s=DT_S)


def fitted(matrices: StateMatrices, data: IoData) -> control.StateSpace:
    A, _ = stabilise(matrices.A)
    fit = fit_inputs(A, matrices.C, [data], noise_weighted=True)
    return control.ss(A, fit.B, matrices.C, fit.D, DT_S)


@pytest.mark.slow
@pytest.mark.parametrize(("colour", "block_rows"), first_of([("white", PAST), ("ar", 2 * PAST)]))
def test_uncertainty___many_seeds___is_within_a_factor_of_two_of_their_scatter(
    colour: str, block_rows: int
) -> None:
    estimate = white if colour == "white" else coloured
    figures, responses, figure_std, response_std = [], [], [], []
    for seed in range(40):
        data = arm_data(seed, colour=colour == "ar")
        model = fitted(estimate(block_gram([data], block_rows)), data)
        modes = ranked_modes(model, [data], output_scale(data))
        nearest = [
            min(modes, key=lambda mode, hz=hz: abs(mode.frequency_hz - hz))  # type: ignore[misc]
            for hz in ARM_HZ
        ]
        figures.append([(mode.frequency_hz, mode.damping_ratio) for mode in nearest])
        responses.append(frequency_response(model, FREQUENCIES_HZ))
        if seed < 8:
            found = jackknife(data, block_rows, estimate)
            figure_std.append([each[2:] for each in mode_uncertainty(found, arm_model())[:3]])
            response_std.append(
                frequency_response_uncertainty(found, data, FREQUENCIES_HZ).deviation
            )
    ratio = rms(figure_std) / np.std(figures, axis=0)
    assert np.all((ratio > 0.5) & (ratio < 2.0)), ratio
    scatter = rms(np.array(responses) - np.mean(responses, axis=0))
    ratio = rms(response_std) / scatter
    assert np.all((ratio > 0.5) & (ratio < 2.0)), ratio


def rms(values: object) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(np.abs(np.asarray(values)) ** 2, axis=0)))


def test_jackknife___whole___is_the_estimate_from_all_data() -> None:
    records = [arm_data(1, colour=False), arm_data(2, colour=False).head(1001)]
    found = jackknife(records, PAST, white)
    expected = white(block_gram(records, PAST))
    np.testing.assert_allclose(found.whole.A, expected.A, rtol=0, atol=1e-8)


def test_jackknife___replicates___are_estimates_without_the_segment() -> None:
    data = arm_data(3, colour=False)
    seen: list[BlockGram] = []

    def estimate(gram: BlockGram) -> StateMatrices:
        seen.append(gram)
        return white(gram)

    found = jackknife(data, PAST, estimate, segments=5)
    z = np.hstack([data.y, data.u])
    columns = len(z) - PAST + 1
    hankel = np.vstack([z[i : i + columns].T for i in range(PAST)])
    assert len(found.replicates) == 5
    edges = np.linspace(0, columns, 6).astype(int)
    # The estimate from all data is the last one.
    for gram, first, last in zip(seen[:5], edges[:-1], edges[1:], strict=True):
        kept = np.delete(hankel, np.arange(first, last), axis=1)
        assert gram.columns == kept.shape[1]
        scale = np.abs(gram.matrix).max()
        np.testing.assert_allclose(gram.matrix, kept @ kept.T, rtol=0, atol=1e-11 * scale)


def test_jackknife___several_records___segments_keep_to_their_record() -> None:
    records = [arm_data(1, colour=False), arm_data(2, colour=False).head(1001)]
    found = jackknife(records, PAST, white, segments=8)
    assert len(found.replicates) == 8
    for remainder in found.remainders:
        assert 3000 < sum(len(piece) for piece in remainder) < 4001
    # A segment at an end leaves one piece of its record, one inside leaves two.
    assert {len(remainder) for remainder in found.remainders} == {2, 3}


def test_uncertainty___noise_free___is_zero() -> None:
    data = record(random_model(4), 800, 4)
    found = jackknife(data, 10, lambda gram: innovation_scaled(gram).matrices(5))
    for mode in mode_uncertainty(found, random_model(4)):
        assert mode.frequency_std_hz < 1e-6
        assert mode.damping_std < 1e-8
    response = frequency_response_uncertainty(found, data, FREQUENCIES_HZ)
    expected = frequency_response(random_model(4), FREQUENCIES_HZ)
    np.testing.assert_allclose(response.response, expected, atol=1e-7)
    assert response.deviation.max() < 1e-7


def test_mode_uncertainty___identified_model___follows_its_ranked_modes() -> None:
    data = arm_data(5, colour=False)
    model = identify(data, order=9, block_rows=PAST, method="orse")
    found = mode_uncertainty(jackknife(data, PAST, white), model.model)
    for figure in ("frequency_hz", "damping_ratio"):
        expected = [getattr(each, figure) for each in model.modes]
        assert [getattr(each, figure) for each in found] == pytest.approx(expected, rel=1e-9)


def test_frequency_response_uncertainty___feedthrough___is_fitted() -> None:
    model = random_model(6, feedthrough=True)
    data = record(model, 800, 6)
    found = jackknife(data, 10, lambda gram: innovation_scaled(gram).matrices(5))
    response = frequency_response_uncertainty(found, data, [1.0, 30.0], feedthrough=True)
    expected = frequency_response(model, [1.0, 30.0])
    np.testing.assert_allclose(response.response, expected, atol=1e-7)
    assert np.abs(pulse_responses(model)[0]).max() > 0.1


def test_jackknife___four_times_the_noise_power___twice_the_deviation() -> None:
    data = arm_data(7, colour=False)
    clean = step_by_step(arm_model(), data.u)
    quiet, loud = (replace(data, y=clean + part * (data.y - clean)) for part in (0.1, 0.2))
    one, two = (
        [each.frequency_std_hz for each in mode_uncertainty(jackknife(d, PAST, white), arm_model())]
        for d in (quiet, loud)
    )
    np.testing.assert_allclose(two[:3], 2.0 * np.array(one[:3]), rtol=0.1)


def test_jackknife___too_short___raises_with_a_remedy() -> None:
    data = replace(arm_data(8, colour=False).head(50), source="run 8")
    with pytest.raises(DataError, match="run 8: 50 samples are too few for 4 segments of 12 block"):
        jackknife(data, PAST, white)

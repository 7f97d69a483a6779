from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from flexarm_ident import DataError, IoData, identify, preprocess, recover_gains
from flexarm_ident.records.preprocess import low_pass, output_scale, remove_compensation
from support.ident_systems import DT_S, arm_model, square_wave, step_by_step

OFFSET = np.array([0.3, -0.2, 0.1, 0.05])


def rested(samples: int = 3000, rest: int = 200) -> IoData:
    """Return a record that rests, then moves; the position's mean is far from zero."""
    u = np.where(np.arange(samples) < rest, 0.0, square_wave(samples, 1)[:, 0] + 0.3)[:, np.newaxis]
    return IoData(u, step_by_step(arm_model(), u), dt_s=DT_S)


def test_remove_compensation___recorded_part___is_subtracted_once() -> None:
    data = IoData(np.ones(5), np.zeros((5, 4)), dt_s=DT_S, compensation=np.full(5, 0.7))
    removed = remove_compensation(data)
    np.testing.assert_allclose(removed.u[:, 0], 0.3)
    np.testing.assert_array_equal(remove_compensation(removed).u, removed.u)
    np.testing.assert_array_equal(preprocess(data, compensation="keep").u, data.u)


def test_preprocess___record_that_starts_at_rest___bias_is_that_of_the_rest() -> None:
    clean = rested()
    data = IoData(clean.u, clean.y + OFFSET, dt_s=DT_S)
    prepared = preprocess(data)
    assert abs(clean.y[:, 0].mean()) > 0.1
    np.testing.assert_allclose(prepared.y[:, [0, 3]], clean.y[:, [0, 3]], atol=1e-12)
    np.testing.assert_allclose(prepared.y[:, [1, 2]].mean(axis=0), 0.0, atol=1e-12)


def test_preprocess___record_that_starts_in_motion___position_keeps_its_level() -> None:
    clean = rested()
    data = IoData(clean.u[500:], clean.y[500:], dt_s=DT_S)
    np.testing.assert_array_equal(preprocess(data).y[:, [0, 3]], data.y[:, [0, 3]])


def test_preprocess___other_biases___are_what_they_say() -> None:
    data = rested()
    first = preprocess(data, bias="first", zero_mean=())
    np.testing.assert_array_equal(first.y[0], np.zeros(4))
    mean = preprocess(data, bias="mean")
    np.testing.assert_allclose(mean.y.mean(axis=0), 0.0, atol=1e-12)
    none = preprocess(data, bias="none", zero_mean=())
    np.testing.assert_array_equal(none.y, data.y)
    with pytest.raises(DataError, match="bias must be rest, first, mean or none: 'median'"):
        preprocess(data, bias="median")


def test_preprocess___closed_loop_record___linear_law_still_holds() -> None:
    rng = np.random.default_rng(2)
    y, reference = rng.normal(size=(400, 4)) + OFFSET, rng.normal(size=400)
    effort = 1.2 * (reference - y[:, 0]) - 2.8 * y[:, 3]
    data = IoData(effort + 0.7, y, dt_s=DT_S, compensation=np.full(400, 0.7), reference=reference)
    gains = recover_gains(preprocess(data, bias="mean", cutoff_hz=50.0))
    assert gains is not None
    np.testing.assert_allclose([gains.kp, gains.kd, gains.ksg], [1.2, 2.8, 0.0], atol=1e-8)


def test_low_pass___butterworth___matches_scipy_from_steady_state() -> None:
    data = rested()
    b, a = signal.butter(2, 50.0, fs=300.0)
    filtered = low_pass(data, 50.0)
    padding = np.repeat(data.y[:1], 2000, axis=0)
    expected = signal.lfilter(b, a, np.vstack([padding, data.y]), axis=0)[2000:]
    np.testing.assert_allclose(filtered.y, expected, atol=1e-10)
    np.testing.assert_array_equal(low_pass(data, 50.0, filter_input=False).u, data.u)


def test_preprocess___input_and_outputs_filtered_alike___model_is_the_same() -> None:
    model, data = arm_model(), rested()
    found = identify(preprocess(data, cutoff_hz=60.0, zero_mean=()), order=9, block_rows=20)
    expected = np.sort_complex(np.linalg.eigvals(model.A))
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(found.model.A)), expected, atol=1e-5
    )


def test_preprocess___cutoff_not_below_nyquist___raises() -> None:
    with pytest.raises(DataError, match="Nyquist frequency 150 Hz: 150"):
        preprocess(rested(), cutoff_hz=150.0)
    with pytest.raises(DataError, match=r"Nyquist frequency 37\.5 Hz: 50"):
        preprocess(rested(), cutoff_hz=50.0, decimation=4)
    with pytest.raises(DataError, match=r"decimation by 4 needs a cutoff_hz below 37\.5 Hz"):
        preprocess(rested(), decimation=4)
    with pytest.raises(DataError, match="decimation must be 1 or more: 0"):
        preprocess(rested(), decimation=0)


def test_preprocess___decimation___keeps_every_nth_filtered_sample() -> None:
    data = rested()
    thinned = preprocess(data, cutoff_hz=30.0, decimation=4, zero_mean=())
    np.testing.assert_array_equal(thinned.y, low_pass(data, 30.0).y[::4])
    assert thinned.dt_s == pytest.approx(4 * DT_S)


def test_output_scale___outputs___reach_the_inputs_maximum_and_orse_thesis_undoes_it() -> None:
    data = rested()
    data = replace(data, y=data.y + np.random.default_rng(0).normal(0.0, 0.01, data.y.shape))
    factors = output_scale(data)
    scaled = replace(data, y=data.y * factors)
    np.testing.assert_allclose(np.abs(scaled.y).max(axis=0), np.abs(data.u).max())
    theirs = identify(scaled, order=9, block_rows=20, method="orse_thesis")
    ours = identify(data, order=9, block_rows=20, method="orse_thesis")
    y = step_by_step(ours.model, data.u, ours.x0[0])
    expected = step_by_step(theirs.model, data.u, theirs.x0[0]) / factors
    np.testing.assert_allclose(y, expected, atol=1e-6 * np.abs(data.y).max())
    assert output_scale(IoData(data.u, np.zeros_like(data.y), dt_s=DT_S)).tolist() == [1.0] * 4

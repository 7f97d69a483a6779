from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from flexarm_ident import DataError, IoData, identify, preprocess, recover_gains
from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.records.preprocess import low_pass, output_scale, remove_compensation
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.ident_systems import DT_S, arm_model, random_model, square_wave, step_by_step

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
    found = identify(
        preprocess(data, cutoff_hz=60.0, zero_mean=()), order=9, block_rows=20, method="orse"
    )
    expected = np.sort_complex(np.linalg.eigvals(model.A))
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(found.model.A)), expected, atol=1e-5
    )


def test_preprocess___cutoff_not_below_nyquist___raises() -> None:
    with pytest.raises(DataError, match="Nyquist frequency 150 Hz: 150; lower it"):
        preprocess(rested(), cutoff_hz=150.0)


def noisy(seed: int, samples: int = 3000) -> IoData:
    """Return an open-loop record with some noise, which moves from the start."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((samples, 1))
    y = step_by_step(random_model(seed, states=4, outputs=2, inputs=1), u)
    y += 0.05 * y.std(axis=0) * rng.standard_normal(y.shape)
    return IoData(u, y, dt_s=DT_S, inputs=("u",), outputs=("y", "z"))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "exponents", [(0, -200, -200), (0, 0, -200), (200, 0, 0), (-60, 150, -310)]
)
def test_preprocess___channels_far_from_1___are_scaled_and_give_the_same_model(
    exponents: tuple[int, int, int],
) -> None:
    plain = noisy(1)
    # In steps: a power of ten may be beyond the range of numbers itself.
    powers = np.array(exponents)
    u, y = (
        values * 10.0 ** (power // 2) * 10.0 ** (power - power // 2)
        for values, power in ((plain.u, powers[:1]), (plain.y, powers[1:]))
    )
    prepared = preprocess(replace(plain, u=u, y=y))
    found, expected = (
        identify(prepared, order=4, method="orse"),
        identify(preprocess(plain), order=4, method="orse"),
    )
    np.testing.assert_allclose(found.fit_error, expected.fit_error, rtol=1e-3)
    poles, same = (np.sort_complex(np.linalg.eigvals(each.model.A)) for each in (found, expected))
    np.testing.assert_allclose(poles, same, rtol=1e-3)
    reported = [notice for notice in prepared.notices if notice.code == "converted"]
    assert len(reported) == np.count_nonzero(powers)
    assert all("was multiplied by 1e" in notice.text for notice in reported)


@pytest.mark.filterwarnings("error")
def test_preprocess___offset_of_many_deviations___is_removed_with_a_notice() -> None:
    clean = noisy(2)
    data = replace(clean, y=16.0 * clean.y / clean.y.std(axis=0) + [1e6, 0.0])
    prepared = preprocess(data)
    assert abs(prepared.y[:, 0].mean()) < 1e-6
    np.testing.assert_array_equal(prepared.y[:, 1], data.y[:, 1])
    (notice,) = prepared.notices
    assert (notice.code, notice.text) == (
        "converted",
        "y had an offset of 1e+06, which was removed",
    )
    level = clean.y[:, 0].mean()
    same = replace(clean, y=clean.y - [level, 0.0])
    errors = [identify(preprocess(each), order=4, method="orse").fit_error for each in (same, data)]
    np.testing.assert_allclose(errors[1], errors[0], rtol=1e-3)
    np.testing.assert_array_equal(preprocess(data, bias="none").y, data.y)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("level", [0.0, 3.7])
def test_constant_output___neither_spoils_nor_flatters_model_and_mean(level: float) -> None:
    clean = noisy(3)
    data = preprocess(replace(clean, y=np.column_stack([clean.y[:, 0], np.full(3000, level)])))
    assert not data.y[:, 1].any()
    outcome = run(data, Request(method="orse", train_fraction=0.5))
    alone = replace(clean, y=clean.y[:, :1], outputs=("y",))
    expected = run(preprocess(alone), Request(method="orse", train_fraction=0.5))
    (dmv,) = outcome.dmv
    assert dmv.mean == pytest.approx(expected.dmv[0].mean, rel=0.05)
    assert mean_error(outcome.dmv_errors) == pytest.approx(mean_error(dmv.error))
    assert mean_error(outcome.identification.fit_error) == outcome.identification.fit_error[0]
    assert np.isnan([outcome.dmv_errors[1], outcome.identification.fit_error[1]]).all()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("factor", "complaint"),
    [
        (0.0, r"run: no output changes \(y, z\), there is nothing to identify: record a rig"),
        (1e-200, "run: y reaches .*e-199, too far from 1 to compute with: prepare the record with"),
        (1e200, "run: y reaches .*too far from 1"),
    ],
)
def test_identify___outputs_that_cannot_be_computed_with___are_refused(
    factor: float, complaint: str
) -> None:
    data = noisy(4)
    with pytest.raises(DataError, match=complaint):
        identify(replace(data, y=data.y * factor, source="run"), method="orse")


def test_output_scale___outputs___reach_the_inputs_maximum_and_orse_thesis_undoes_it() -> None:
    data = rested()
    data = replace(data, y=data.y + np.random.default_rng(0).normal(0.0, 0.01, data.y.shape))
    factors = output_scale(data)
    scaled = replace(data, y=data.y * factors)
    np.testing.assert_allclose(np.abs(scaled.y).max(axis=0), np.abs(data.u).max())
    theirs = identify(scaled, order=9, block_rows=20, method="orse_thesis")
    ours = identify(data, order=9, block_rows=20, method="orse_thesis")
    # B is fitted behind that, to the outputs as they are; the states have a unit of their own.
    np.testing.assert_allclose(ours.model.A, theirs.model.A, atol=1e-7)
    found, expected = ours.model.C * factors[:, np.newaxis], theirs.model.C
    np.testing.assert_allclose(
        found / np.linalg.norm(found), expected / np.linalg.norm(expected), atol=1e-7
    )
    assert output_scale(IoData(data.u, np.zeros_like(data.y), dt_s=DT_S)).tolist() == [1.0] * 4

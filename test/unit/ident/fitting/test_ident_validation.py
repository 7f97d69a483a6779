from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_ident import (
    Gains,
    IdentificationError,
    IoData,
    recover_gains,
    validate_dmv,
    validate_sfv,
)
from flexarm_ident.fitting.validation import (
    fit_percent,
    frequency_response,
    mean_error,
    relative_errors,
)
from support.ident_systems import DT_S, arm_model, named, random_model, record, square_wave

KP, KD, KSG = 0.6, 0.4, 0.05


def closed_loop(
    samples: int = 1500, *, compensation_v: float = 0.7, noise_v: float = 0.0, ksg: float = KSG
) -> IoData:
    """Return an experiment under ``u = kp (R - y1) - kd y4 - ksg y3``, answered in its own row.

    The plant feels the effort alone: the compensation is taken to cancel the friction.
    """
    model, rng = arm_model(), np.random.default_rng(1)
    x = np.zeros(model.nstates)
    reference = square_wave(samples, 3, half_period=(300, 500))[:, 0]
    y, effort = np.empty((samples, 4)), np.empty(samples)
    for k in range(samples):
        y[k] = model.C @ x + noise_v * rng.normal(size=4)
        effort[k] = KP * (reference[k] - y[k, 0]) - KD * y[k, 3] - ksg * y[k, 2]
        x = model.A @ x + model.B[:, 0] * effort[k]
    compensation = compensation_v * np.sign(effort)
    return IoData(
        effort + compensation,
        y,
        dt_s=DT_S,
        closed_loop=True,
        compensation=compensation,
        reference=reference,
        source="run",
    )


def test_relative_errors___known_signals___closed_form() -> None:
    t = np.arange(1000) * 2.0 * np.pi / 1000
    measured = np.stack([3.0 * np.sin(t), 2.0 * np.cos(t), np.sin(t)], axis=1)
    simulated = np.stack([2.0 * np.sin(t), 2.0 * np.cos(t), np.full(1000, np.inf)], axis=1)
    np.testing.assert_allclose(relative_errors(measured, simulated), [1 / 3, 0.0, np.inf])


def test_mean_error___outputs_that_are_constant___neither_spoil_nor_flatter_it() -> None:
    t = np.arange(1000) * 2.0 * np.pi / 1000
    measured = np.stack([3.0 * np.sin(t), np.full(1000, 3.7), np.zeros(1000)], axis=1)
    measured[5:9] = np.nan
    simulated = np.stack([2.0 * np.sin(t), np.full(1000, 3.7), np.full(1000, 1e-9)], axis=1)
    errors = relative_errors(measured, simulated)
    np.testing.assert_allclose(errors, [1 / 3, np.nan, np.nan], rtol=1e-2)
    assert mean_error(errors) == errors[0]
    assert np.isnan(mean_error(errors[1:]))


def test_validate_dmv___model_half_as_strong___closed_form() -> None:
    model = random_model(1)
    data = record(model, 400, seed=1, at_rest=True)
    weak = named(model.A, model.B * 0.5, model.C, model.D)
    dmv = validate_dmv(weak, data, np.zeros(model.nstates))
    np.testing.assert_allclose(dmv.delta, 0.5, rtol=1e-12)
    assert dmv.mean == pytest.approx(0.5)
    np.testing.assert_allclose(dmv.y, 0.5 * data.y, atol=1e-12)


def test_validate_dmv___true_model_in_motion___initial_state_is_fitted() -> None:
    model = random_model(2)
    data = record(model, 400, seed=2)
    assert validate_dmv(model, data).mean < 1e-10
    assert validate_dmv(model, data, np.zeros(model.nstates)).mean > 1e-3


def test_validate_dmv___model_and_record_do_not_match___raises() -> None:
    model, data = random_model(3), record(random_model(3), 100, seed=3)
    with pytest.raises(IdentificationError, match="model has 1 inputs and 4 outputs"):
        validate_dmv(arm_model(), data)
    with pytest.raises(IdentificationError, match=r"the model's period is 0\.00\d+ s"):
        validate_dmv(model, replace(data, dt_s=0.002))
    renamed = replace(data, inputs=("left", "right"))
    with pytest.raises(IdentificationError, match=r"its inputs are left, right, the model's "):
        validate_dmv(model, renamed)
    with pytest.raises(IdentificationError, match=r"its outputs are .*, the model's "):
        validate_dmv(model, replace(data, outputs=data.outputs[::-1]))
    nameless = control.ss(model.A, model.B, model.C, model.D, model.dt)
    assert validate_dmv(nameless, renamed).mean < 1e-10
    with pytest.raises(IdentificationError, match="x0 has 2 states, the model has 5"):
        validate_dmv(model, data, [0.0, 1.0])


def test_recover_gains___linear_law___exact_also_with_noise_in_the_outputs() -> None:
    gains = recover_gains(closed_loop(noise_v=0.05))
    assert gains is not None
    expected = [KP, KD, KSG, 0.0]
    np.testing.assert_allclose([gains.kp, gains.kd, gains.ksg, gains.offset_v], expected, atol=1e-9)


def test_recover_gains___drive_saturates___saturated_rows_are_left_out() -> None:
    data = closed_loop(noise_v=0.05)
    limit_v = float(np.quantile(np.abs(data.u), 0.9))
    cut = replace(data, u=data.u.clip(-limit_v, limit_v))
    gains = recover_gains(cut, limit_v=limit_v)
    assert gains is not None
    np.testing.assert_allclose([gains.kp, gains.kd, gains.ksg], [KP, KD, KSG], atol=1e-9)
    assert recover_gains(cut) is None


def test_recover_gains___effort_of_something_else___none() -> None:
    data = closed_loop(noise_v=0.05)
    assert data.reference is not None
    integral = 0.01 * np.cumsum(data.reference - data.y[:, 0])[:, np.newaxis]
    assert recover_gains(replace(data, u=data.u + integral)) is None
    assert recover_gains(replace(data, reference=None)) is None
    assert recover_gains(replace(data, outputs=("a", "b", "c", "d"))) is None
    late = np.roll(data.effort, 1, axis=0)
    assert recover_gains(replace(data, u=late, compensation=None)) is None
    assert recover_gains(data.head(3)) is None


def test_validate_sfv___true_model___follows_the_experiment_exactly() -> None:
    data = closed_loop()
    sfv = validate_sfv(arm_model(), data)
    assert sfv.mean < 1e-6
    assert sfv.gains.kd == pytest.approx(KD, abs=1e-8)


def test_validate_sfv___wrong_model_and_given_gains___equals_the_loop_by_hand() -> None:
    data, true = closed_loop(), arm_model()
    model = control.ss(
        true.A,
        0.8 * true.B,
        true.C,
        true.D,
        DT_S,
        inputs=list(true.input_labels),
        outputs=list(true.output_labels),
    )
    sfv = validate_sfv(model, data, Gains(0.5, 0.3, 0.02, 0.01))
    x = validate_dmv(model, replace(data, u=data.effort)).x0
    assert data.reference is not None
    expected = np.empty_like(data.y)
    for k in range(len(data)):
        y = expected[k] = model.C @ x
        u = 0.5 * (data.reference[k] - y[0]) - 0.3 * y[3] - 0.02 * y[2] + 0.01
        x = model.A @ x + model.B[:, 0] * u
    np.testing.assert_allclose(sfv.y, expected, atol=1e-9)
    np.testing.assert_allclose(sfv.delta, relative_errors(data.y, expected), rtol=1e-9)


def test_validate_sfv___not_available___raises_with_the_reason() -> None:
    data = closed_loop()
    with pytest.raises(IdentificationError, match="run: SFV needs the recorded reference"):
        validate_sfv(arm_model(), replace(data, reference=None))
    with pytest.raises(IdentificationError, match=r"run: no linear law .* give the gains"):
        validate_sfv(arm_model(), replace(data, u=data.u**3))
    direct = arm_model()
    direct.D = np.ones((4, 1))
    with pytest.raises(IdentificationError, match="without feedthrough"):
        validate_sfv(direct, data)


def test_frequency_response___random_model___equals_python_control() -> None:
    model = random_model(4, feedthrough=True)
    hz = np.geomspace(0.1, 149.0, 1100)
    expected = control.frequency_response(model, 2.0 * np.pi * hz, squeeze=False)
    found = frequency_response(model, hz)
    np.testing.assert_allclose(found, np.moveaxis(expected.complex, 2, 0), rtol=1e-9)


def test_recover_gains___some_samples_unanswered___still_exact() -> None:
    rng = np.random.default_rng(5)
    y = rng.normal(size=(1000, 4))
    reference = np.where(np.arange(1000) % 200 < 100, 3.0, -3.0)
    effort = 0.9 * (reference - y[:, 0]) - 2.5 * y[:, 3] - 0.2 * y[:, 2]
    for row in rng.choice(np.arange(1, 1000), 60, replace=False):
        effort[row] = effort[row - 1]
    gains = recover_gains(IoData(effort, y, dt_s=1 / 300, reference=reference))
    assert gains is not None
    assert (gains.kp, gains.kd, gains.ksg) == pytest.approx((0.9, 2.5, 0.2), abs=1e-6)


@given(st.integers(0, 1000), st.floats(-50.0, 50.0), st.floats(0.1, 10.0))
def test_validate_dmv___error___is_the_nrmse_whatever_the_offset(
    seed: int, offset: float, scale: float
) -> None:
    model = random_model(seed, 4, 2, 1)
    data = record(model, 300, seed, noise=0.3)
    found = validate_dmv(model, replace(data, y=scale * data.y + offset))
    missed = np.sqrt(np.mean((scale * data.y + offset - found.y) ** 2, axis=0))
    np.testing.assert_allclose(found.error, missed / (scale * data.y.std(axis=0)), rtol=1e-6)
    # Ljung's fit is 100 (1 - NRMSE).
    fit = fit_percent(scale * data.y + offset, found.y)
    np.testing.assert_allclose(100.0 * (1.0 - found.error), fit, atol=1e-6)

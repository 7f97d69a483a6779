from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from flexarm_ident import IoData
from flexarm_ident.diagnostics.verdict import (
    CROSS_VALIDATED,
    ESTIMATION_DATA,
    HELD_OUT,
    Level,
    missed_shares,
    verdict,
)
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.exhaustive import first_of
from support.ident_systems import DT_S, arm_model, random_model, record, square_wave, step_by_step

NAMES = ("position", "strain", "speed", "tip")


def judged(
    *errors: float, missed: float = 0.5, validation: str = CROSS_VALIDATED
) -> tuple[str, str]:
    shares = np.full(len(errors), missed)
    found = verdict(np.array(errors), shares, NAMES[: len(errors)], validation=validation)
    return str(found.level), str(found)


@pytest.mark.parametrize(
    ("errors", "level"),
    [
        ((0.05, 0.1), "good"),
        ((0.2,), "good"),
        ((0.21,), "usable"),
        ((0.5, 0.5), "usable"),
        ((0.6,), "poor"),
        ((0.91,), "not usable"),
        ((np.inf,), "not usable"),
        # The worst output may be a level worse than the mean, not two.
        ((0.01, 0.01, 0.01, 0.45), "good"),
        ((0.01, 0.01, 0.01, 0.6), "usable"),
        ((0.01, 0.01, 0.01, 3.0), "poor"),
        ((0.1, np.nan), "good"),
    ],
)
def test_verdict___errors___give_the_level(errors: tuple[float, ...], level: str) -> None:
    assert judged(*errors)[0] == level


def test_verdict___error_that_follows_no_input___is_as_good_as_the_record_allows() -> None:
    # 0.6 sqrt(0.1) = 0.19 could be avoided.
    assert judged(0.6, missed=0.1)[0] == "usable"
    assert judged(0.6, missed=0.12)[0] == "poor"
    # Nothing is to be told from a record that shows nothing.
    assert judged(1.0, missed=0.0)[0] == "not usable"
    # Noise is as large as the output at most: what is larger was made by the model.
    assert judged(0.6, 1.1, missed=0.01)[0] == "poor"


def test_verdict___model_worse_than_the_mean___is_not_usable_in_its_first_words() -> None:
    text = judged(1.97, 0.8, missed=0.9)[1]
    assert text.startswith("not usable, worse than the mean: fit -38.5 % (NRMSE, simulation, ")
    # The error is (1.97 + 0.8) / 2.
    assert "cross-validated; lowest -97.0 %, position); 90 % of the residual power is" in text
    assert "(most of it can be modelled). Next: try another method" in text


def test_verdict___unknown_share___is_not_reported() -> None:
    text = judged(0.3, missed=np.nan, validation=ESTIMATION_DATA)[1]
    assert text.startswith("usable: fit 70.0 % (NRMSE, simulation, estimation data). Next: ")
    assert "coherent" not in text


def test_verdict___defects___are_the_next_step() -> None:
    found = verdict(
        np.array([0.95]),
        np.array([0.9]),
        ("y",),
        validation=CROSS_VALIDATED,
        defects=("delay", "delay"),
    )
    assert found.next_step == "fix the data (delay), see the notes"
    good = verdict(
        np.array([0.1]), np.array([0.9]), ("y",), validation=CROSS_VALIDATED, defects=("offset",)
    )
    assert good.next_step == "use the model, but check the data (offset), see the notes"


def test_verdict___few_values___is_never_good() -> None:
    found = verdict(
        np.array([0.01]),
        np.array([0.0]),
        ("y",),
        validation=CROSS_VALIDATED,
        defects=("few values",),
        few_values=True,
    )
    assert found.level == Level.USABLE
    assert found.next_step == "fix the data (few values), see the notes"


def test_verdict___outputs_missed_by_different_parts___share_is_joined_by_power() -> None:
    found = verdict(
        np.array([0.3, 0.1]), np.array([1.0, 0.0]), ("a", "b"), validation=CROSS_VALIDATED
    )
    # 0.3**2 / (0.3**2 + 0.1**2); by amplitude it would be 0.75, without weights 0.5.
    assert found.missed == pytest.approx(0.9)


@pytest.mark.parametrize("noise", [0.1, 1.0])
def test_missed_shares___error_that_is_noise___is_none(noise: float) -> None:
    data = record(random_model(1), 20_000, 1, noise=noise)
    clean = record(random_model(1), 20_000, 1)
    assert np.all(missed_shares([data], [clean.y]) < 0.03)


def test_missed_shares___missing_mode_and_noise_of_equal_power___is_a_half() -> None:
    rng = np.random.default_rng(2)
    u = signal.lfilter([1.0], [1.0, -0.5], rng.normal(size=(20_000, 1)), axis=0)
    mode = signal.lfilter([0.0, 1.0], [1.0, -1.2, 0.8], u, axis=0)
    y = mode + mode.std() * rng.normal(size=u.shape)
    data = IoData(u, y, dt_s=DT_S, inputs=("u",), outputs=("y",))
    assert missed_shares([data], [np.zeros_like(y)])[0] == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("declared", [True, False])
def test_missed_shares___noise_that_a_controller_feeds_back___follows_no_input(
    *, declared: bool
) -> None:
    model, rng = arm_model(), np.random.default_rng(3)
    reference = 0.3 * square_wave(12_000, 3, (100, 400))
    x, u = np.zeros(model.nstates), np.zeros((12_000, 1))
    clean, noise = np.zeros((12_000, 4)), 0.3 * rng.normal(size=(12_000, 4))
    for k in range(len(u)):
        clean[k] = model.C @ x
        u[k] = reference[k] - np.array([[1.0, 0.0, 0.0, 1.0]]) @ (clean[k] + noise[k])
        x = model.A @ x + model.B @ u[k]
    data = IoData(u, clean + noise, dt_s=DT_S, closed_loop=declared)
    share = missed_shares([data], [clean])[3]
    # The true model misses nothing; without the loop's knowledge the input seems to tell the noise.
    assert share < 0.05 if declared else share > 0.3


def test_missed_shares___short_record___are_not_known() -> None:
    data = record(random_model(4), 150, 4)
    assert np.all(np.isnan(missed_shares([data], [data.y])))


def test_missed_shares___simulation_that_runs_away___is_judged_where_it_is_finite() -> None:
    data = record(random_model(5), 3000, 5, noise=0.1)
    wild = data.y.copy()
    wild[2000:] = np.inf
    assert np.all(np.isfinite(missed_shares([data], [wild])))


@pytest.mark.parametrize(("fraction", "validation"), [(1.0, CROSS_VALIDATED), (0.5, HELD_OUT)])
def test_outcome___noisy_record___is_judged_on_data_left_out(
    fraction: float, validation: str
) -> None:
    data = record(random_model(6), 4000, 6, noise=0.1)
    outcome = run(data, Request(order=5, block_rows=10, method="orse", train_fraction=fraction))
    # The noise alone makes the error 0.1 / sqrt(1.01).
    assert outcome.verdict.error == pytest.approx(0.0995, rel=0.05)
    assert outcome.verdict.validation == validation
    assert outcome.verdict.level == Level.GOOD
    assert outcome.verdict.missed < 0.05


def test_outcome___half_of_the_record_is_another_plant___error_is_that_of_the_half_left_out() -> (
    None
):
    data = record(random_model(7), 4000, 7, noise=0.05)
    other = record(random_model(7), 4000, 7)
    y = data.y.copy()
    y[2000:] = -other.y[2000:]
    outcome = run(
        replace(data, y=y),
        Request(order=5, block_rows=10, method="orse", train_fraction=0.5, bias="none"),
    )
    assert outcome.verdict.error == pytest.approx(2.0, rel=0.02)
    assert str(outcome.verdict).startswith("not usable, worse than the mean: ")


def test_outcome___input_delayed_by_60_samples___is_not_usable_for_the_delay() -> None:
    u = square_wave(6000, 8)
    y = step_by_step(arm_model(), np.vstack([np.zeros((60, 1)), u[:-60]]))
    y += 0.02 * y.std(axis=0) * np.random.default_rng(8).normal(size=y.shape)
    outcome = run(IoData(u, y, dt_s=DT_S), Request(order=9, block_rows=20, method="orse"))
    assert outcome.verdict.level >= Level.POOR
    assert "fix the data (delay)" in str(outcome.verdict)


@pytest.mark.parametrize("offset", first_of([1.0, 6.0, 10.0]))
@pytest.mark.parametrize("noise", [0.05, 3.0])
def test_verdict___offset_of_an_output___flatters_no_error(offset: float, noise: float) -> None:
    model = random_model(3, 4, 2, 1)
    data = record(model, 4000, 3, noise=noise)
    shifted = replace(data, y=data.y + offset * data.y.std(axis=0))
    plain, moved = (run(each, Request(order=6, method="pbsid")) for each in (data, shifted))
    # Another level is one more state that the fit spends.
    np.testing.assert_allclose(moved.dmv_errors, plain.dmv_errors, rtol=0.1, atol=0.02)
    assert moved.verdict.error == pytest.approx(plain.verdict.error, rel=0.1, abs=0.02)
    assert moved.verdict.level == plain.verdict.level

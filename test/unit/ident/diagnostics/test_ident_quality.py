from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import signal

from flexarm_ident import IoData
from flexarm_ident.diagnostics.channel_defects import duplicates
from flexarm_ident.diagnostics.excitation import excited_band_hz, few_values
from flexarm_ident.diagnostics.quality import assess
from flexarm_ident.records.data_warning import DataWarning, Grade
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.methods import select_method
from support.ident_systems import DT_S, arm_model, random_model, record, square_wave, step_by_step

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

BLOCK_ROWS = 20
SAMPLES = 4000
TIMES_S = np.arange(SAMPLES) * DT_S


def response(u: Array, seed: int = 0, noise: float = 0.02) -> IoData:
    """Return the arm's noisy answer to an input, in open loop."""
    y = step_by_step(arm_model(), u)
    y += noise * y.std(axis=0) * np.random.default_rng(seed).normal(size=y.shape)
    return IoData(u, y, dt_s=DT_S, source="run 3")


def warnings(*records: IoData, block_rows: int = BLOCK_ROWS) -> dict[str, DataWarning]:
    found = assess(records, block_gram(records, block_rows))
    assert len({warning.code for warning in found}) == len(found)
    return {warning.code: warning for warning in found}


def sine(hz: float) -> Array:
    return np.asarray(np.sin(2.0 * np.pi * hz * TIMES_S)[:, np.newaxis])


def test_assess___sine___names_condition_and_band() -> None:
    data = response(sine(6.0))
    condition, band = assess([data], block_gram([data], BLOCK_ROWS))
    assert condition.code == band.code == "excitation"
    assert (condition.grade, band.grade) == (Grade.CAUTION, Grade.INFORMATION)
    assert condition.figures["condition"] > 1e12
    figures = band.figures
    assert 3.0 < figures["low_hz"] < 6.0 < figures["high_hz"] < 9.0
    assert figures["share"] < 0.05


def test_assess___sweep___band_ends_where_the_sweep_does() -> None:
    u = signal.chirp(TIMES_S, 0.2, TIMES_S[-1], 60.0)[:, np.newaxis]
    data = response(u)
    (figures,) = (
        each.figures
        for each in assess([data], block_gram([data], BLOCK_ROWS))
        if each.grade == Grade.INFORMATION
    )
    assert figures["high_hz"] == pytest.approx(60.0, abs=3.0)
    assert figures["share"] == pytest.approx(60.0 / 150.0, abs=0.03)


@pytest.mark.parametrize(
    "u",
    [
        np.random.default_rng(1).normal(size=SAMPLES),
        np.cumsum(np.random.default_rng(2).normal(size=SAMPLES)),
        np.repeat(np.random.default_rng(3).normal(size=SAMPLES // 50), 50),
        square_wave(SAMPLES, 4, (300, 400))[:, 0],
    ],
    ids=["white", "random walk", "random steps", "slow square"],
)
def test_excited_band_hz___rich_input___reaches_from_the_lowest_to_nyquist(u: Array) -> None:
    low_hz, high_hz, share = excited_band_hz(u, DT_S)
    assert low_hz < 1.0
    assert high_hz > 149.0
    assert share > 0.95


def saturated(y: Array) -> Array:
    y = y.copy()
    limit = 0.8 * np.abs(y[:, 1]).max()
    y[:, 1] = y[:, 1].clip(-np.inf, limit)
    return y


def quantised_and_saturated(y: Array) -> Array:
    return saturated(np.round(y / 0.0005) * 0.0005)


@pytest.mark.parametrize("defect", [saturated, quantised_and_saturated])
def test_assess___one_output_is_cut_off___names_it_with_level_and_share(
    defect: Callable[[Array], Array],
) -> None:
    clean = response(square_wave(SAMPLES, 5))
    y = defect(clean.y)
    found = warnings(replace(clean, y=y))
    assert set(found) == {"saturation"}
    figures = found["saturation"].figures
    assert figures["level"] == y[:, 1].max()
    on = float(np.mean(y[:, 1] == y[:, 1].max()))
    assert 0.5 * on <= figures["share"] <= on
    assert "run 3: base_strain_v reaches" in str(found["saturation"])


def test_assess___command_is_limited___input_counts_too() -> None:
    rng = np.random.default_rng(6)
    u = signal.lfilter([1.0], [1.0, -0.8], rng.normal(size=SAMPLES))[:, np.newaxis]
    found = warnings(response(u.clip(-2.0, np.inf)))
    assert set(found) == {"saturation"}
    assert found["saturation"].figures["level"] == -2.0


def resting_at_turns(rng: np.random.Generator) -> Array:
    """Encoder of a rubbing joint: it swings to random places, and rests wherever it turns."""
    parts: list[Array] = []
    place, sign = 0.0, 1.0
    while sum(len(part) for part in parts) < SAMPLES:
        reach = sign * rng.uniform(0.5, 1.5)
        swing = place + (reach - place) * 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 60)))
        parts += [swing, np.full(rng.integers(15, 25), reach)]
        place, sign = reach, -sign
    return np.asarray(np.round(np.concatenate(parts)[:SAMPLES] / 0.01) * 0.01)


@pytest.mark.parametrize(
    "x",
    [
        np.round(3.0 * sine(0.3)[:, 0] / 0.005) * 0.005,
        np.concatenate([np.zeros(600), 1.0 + np.sin(np.arange(SAMPLES - 600) / 30.0)]),
        *(resting_at_turns(np.random.default_rng(seed)) for seed in range(3)),
    ],
    ids=["quantised slow sine", "rest at the start", *(f"rests at turns {i}" for i in range(3))],
)
def test_assess___extreme_that_is_no_limit___is_not_called_saturated(x: Array) -> None:
    clean = response(square_wave(SAMPLES, 7))
    y = clean.y.copy()
    y[:, 1] = x
    assert "saturation" not in warnings(replace(clean, y=y))


@pytest.mark.parametrize("part", [0.7, 0.6, 0.5])
def test_assess___rubbing_joint_is_cut_off___limit_is_distinguished_from_rests(part: float) -> None:
    clean = response(square_wave(SAMPLES, 7))
    y = clean.y.copy()
    y[:, 1] = resting_at_turns(np.random.default_rng(7))
    limit = part * y[:, 1].max()
    y[:, 1] = y[:, 1].clip(-np.inf, limit)
    assert warnings(replace(clean, y=y))["saturation"].figures["level"] == limit


def test_assess___offset___is_named_with_mean_and_deviation() -> None:
    clean = response(square_wave(SAMPLES, 8))
    found = warnings(replace(clean, y=clean.y + np.array([0.0, 0.0, 50.0, 0.0])))
    assert set(found) == {"offset"}
    figures = found["offset"].figures
    assert figures["mean"] == pytest.approx(50.0 + clean.y[:, 2].mean())
    assert figures["deviation"] == pytest.approx(clean.y[:, 2].std())
    assert "run 3: middle_strain_v is almost all offset (mean 5" in str(found["offset"])
    assert "remove its bias (--bias mean)" in str(found["offset"])


def test_assess___dead_channel_with_rare_spikes___is_named() -> None:
    clean = response(square_wave(SAMPLES, 9))
    y = clean.y.copy()
    y[:, 2] = 0.125
    y[::400, 2] = 0.3
    found = warnings(replace(clean, y=y))
    assert set(found) == {"constant_channel"}
    assert found["constant_channel"].figures["share"] == pytest.approx(1.0 - 1.0 / 400.0)


@pytest.mark.parametrize("rest", [0.0, 0.1])
@pytest.mark.parametrize("blows", [1, 5])
def test_assess___blows_of_a_hammer___are_an_input(rest: float, blows: int) -> None:
    u = np.full((SAMPLES, 1), rest)
    u[100 :: SAMPLES // blows] = 8.0
    found = warnings(response(u))
    assert "saturation" not in found
    assert ("constant_channel" in found) is (blows < 3)
    if blows < 3:
        assert found["constant_channel"].grade == Grade.CAUTION


def test_assess___channel_without_a_sensor___is_reported_without_a_ban() -> None:
    clean = response(square_wave(SAMPLES, 9))
    y = clean.y * np.array([1.0, 0.0, 1.0, 1.0])
    (found,) = warnings(replace(clean, y=y)).values()
    assert (found.code, found.grade, found.channel) == (
        "constant_channel",
        Grade.CAUTION,
        "base_strain_v",
    )
    assert "is 0 in every sample" in found.text


def test_assess___channel_repeats_another_in_other_units___both_are_named() -> None:
    clean = response(square_wave(SAMPLES, 10))
    y = clean.y.copy()
    y[:, 2] = 0.4 - 57.3 * y[:, 1]
    found = warnings(replace(clean, y=y))
    assert set(found) == {"duplicated_channel"}
    assert found["duplicated_channel"].figures["correlation"] == pytest.approx(-1.0)
    assert "middle_strain_v repeats base_strain_v" in found["duplicated_channel"].text


@pytest.mark.parametrize(
    ("first", "last", "rest"),
    [(0, 400, "--from 1.33333333s --to 10s"), (1500, 1900, "--to 5s")],
    ids=["at first", "later"],
)
def test_assess___gauge_silent_for_a_stretch___is_named_with_its_rows(
    first: int, last: int, rest: str
) -> None:
    clean = response(square_wave(SAMPLES, 16))
    y = clean.y.copy()
    y[first:last, 2] = 0.05
    y[3000:3050, 2] = 0.05
    found = warnings(replace(clean, y=y))
    assert set(found) == {"dead_sensor"}
    ends = [f"{row * DT_S:.6g} s (row {row})" for row in (first, last - 1)]
    assert f"the longest from {ends[0]} to {ends[1]}: check" in found["dead_sensor"].text
    assert found["dead_sensor"].text.endswith(f"leave those rows out ({rest})")
    assert found["dead_sensor"].figures == {
        "samples": last - first + 50.0,
        "share": (last - first + 50.0) / SAMPLES,
        "stretches": 2.0,
        "first_row": float(first),
        "last_row": last - 1.0,
    }
    assert str(found["dead_sensor"]).startswith(
        "run 3: middle_strain_v is dead in 11.2 % of the samples"
    )


def test_assess___rest_of_a_rig_without_noise___is_no_dead_sensor() -> None:
    u = np.concatenate([np.zeros((300, 1)), square_wave(SAMPLES - 300, 17)])
    assert not warnings(response(u, noise=0.0))


def test_assess___encoder_that_rests_among_noisy_gauges___is_no_dead_sensor() -> None:
    u = square_wave(SAMPLES, 18)
    u[2000:3000] = 0.0
    clean = response(u)
    y = clean.y.copy()
    step = 0.05 * np.abs(y[:, 0]).max()
    y[:, 0] = np.round(step_by_step(arm_model(), u)[:, 0] / step) * step
    assert "dead_sensor" not in warnings(replace(clean, y=y))


def test_assess___notices_of_a_record___are_passed_on_with_its_name() -> None:
    notice = DataWarning("lost_samples", "3 samples lost", {"lost": 3.0})
    first = response(square_wave(SAMPLES, 19))
    second = replace(response(square_wave(SAMPLES, 20)), source="run 4", notices=(notice,))
    found = warnings(first, second)
    assert found == {"lost_samples": replace(notice, record="run 4")}


def test_duplicates___command_of_a_proportional_law___is_none() -> None:
    data = response(square_wave(SAMPLES, 10))
    proportional = replace(data, u=0.5 - 2.0 * data.y[:, :1])
    assert list(duplicates(proportional))
    assert not list(duplicates(replace(proportional, closed_loop=True)))
    assert list(duplicates(replace(data, u=data.y[:, :1].copy(), closed_loop=True)))


def test_few_values___five_for_each_parameter___suffice() -> None:
    data = response(square_wave(500, 11, (5, 30)))
    values = 500 * len(data.outputs)
    states = values // (5 * (len(data.inputs) + len(data.outputs) + 1))
    assert not list(few_values([data], states))
    (found,) = few_values([data], states + 1)
    assert found.code == "few_values"
    assert f"{values} values of the outputs for {found.figures['parameters']:.0f}" in found.text


def test_assess___order_is_known___values_are_counted_of_all_records_together() -> None:
    records = [response(square_wave(250, seed, (5, 30)), seed) for seed in (11, 12)]
    gram = block_gram(records, BLOCK_ROWS)
    # Of two records each state has one more initial value.
    states = 2 * 250 * 4 // (5 * (1 + 4 + 2))
    assert not [each for each in assess(records, gram, order=states) if each.code == "few_values"]
    assert [each.code for each in assess(records, gram, order=states + 1)] == ["few_values"]


def controlled(noise: float, seed: int) -> IoData:
    """Return the arm under a PD controller that follows a square wave."""
    model, rng = arm_model(), np.random.default_rng(seed)
    reference = square_wave(SAMPLES, seed)
    gain = np.array([[1.0, 0.0, 0.0, 0.3]])
    x, u, y = np.zeros(model.nstates), np.zeros((SAMPLES, 1)), np.zeros((SAMPLES, 4))
    for k in range(SAMPLES):
        y[k] = model.C @ x + noise * rng.normal(size=4)
        u[k] = reference[k] - gain @ y[k]
        x = model.A @ x + model.B @ u[k]
    return IoData(u, y, dt_s=DT_S, source="run 3")


def test_assess___undeclared_controller___is_found() -> None:
    found = warnings(controlled(0.1, 13))
    assert set(found) == {"feedback"}
    figures = found["feedback"].figures
    assert figures["p_value"] < 1e-6
    assert figures["statistic"] > 1.5 * figures["background"] > figures["degrees"]
    assert "though no loop is declared" in found["feedback"].text


@pytest.mark.parametrize(
    ("noise", "evidence"), [(0.1, "chi-square"), (0.0, "too small to show it")]
)
def test_assess___declared_controller___is_reported_with_the_evidence(
    noise: float, evidence: str
) -> None:
    found = warnings(replace(controlled(noise, 14), closed_loop=True))
    assert set(found) == {"feedback"}
    assert "closed-loop data" in found["feedback"].text
    assert evidence in found["feedback"].text


def test_assess___feedthrough_plant_in_open_loop___needs_the_declaration() -> None:
    data = record(random_model(15, feedthrough=True), SAMPLES, 15, noise=0.05)
    gram = block_gram([data], BLOCK_ROWS)
    (reported,) = assess([data], gram)
    assert reported.code == "feedback"
    assert not assess([data], gram, feedthrough=True)
    # The choice of a method asks later inputs alone: the words of both have to agree.
    chosen = select_method([data], BLOCK_ROWS, closed_loop=False)
    assert "later inputs are not correlated with the outputs' noise" in chosen.reason
    assert "later ones do not" in reported.text
    assert "closed-loop data" not in reported.text

"""Tuning against recomputed optima, and its optimality by simulation of the stepped law."""

from __future__ import annotations

import math
from typing import Any

import control
import numpy as np
import pytest

from flexarm_control import (
    ControlError,
    Margins,
    Pdp,
    PdpGains,
    PdpTuning,
    PiGains,
    margins,
    nominal_model,
    simulate_loop,
    tune_pdp,
    tune_pi,
)
from flexarm_control.models.arm_model import delayed

DT_S = 1 / 300


PRINTED_MODELS = [nominal_model(payload_kg) for payload_kg in (0.0, 0.2, 0.4)]
FLIPPED_MODELS = [
    nominal_model(payload_kg, flip_middle_strain=True) for payload_kg in (0.0, 0.2, 0.4)
]


@pytest.fixture(scope="module")
def printed() -> PdpTuning:
    return tune_pdp(PRINTED_MODELS)


@pytest.fixture(scope="module")
def flipped() -> PdpTuning:
    return tune_pdp(FLIPPED_MODELS)


def _figures(found: Margins) -> tuple[float, ...]:
    return (
        *(found.gain_margin_db, found.gain_margin_hz),
        *(found.phase_margin_deg, found.phase_margin_hz),
    )


def _stepped_criterion(
    models: list[control.StateSpace], gains: PdpGains, set_point_v: float
) -> float:
    """J of (4-3), written out over the samples of the stepped law, set-point as on the arm."""
    time_s = np.arange(1500) * DT_S
    total = 0.0
    for model in models:
        y = simulate_loop(model, Pdp(gains), np.full(1500, set_point_v)).y
        error = DT_S * np.sum(time_s * np.abs(set_point_v - y[:, 0])) / set_point_v
        strain = DT_S * np.sum(time_s[:, None] * np.abs(y[:, 1:3]) / np.abs(y[:, 1:3]).max(axis=0))
        total += 0.5 * error + 0.5 * strain
    return float(total)


@pytest.mark.slow
def test_tune_pdp___printed_models___is_the_recomputed_optimum(printed: PdpTuning) -> None:
    assert printed.criterion == pytest.approx(3.54, abs=0.005)
    assert printed.gains.kp == pytest.approx(0.490, abs=0.002)
    assert printed.gains.kd == pytest.approx(4.33, abs=0.02)
    assert printed.gains.ksg == pytest.approx(0.005, abs=1e-6)
    assert printed.active == ("gain margin of model 3", "bound of ksg")


@pytest.mark.slow
@pytest.mark.exhaustive
def test_tune_pdp___flipped_gauge___is_the_recomputed_optimum(flipped: PdpTuning) -> None:
    assert flipped.criterion == pytest.approx(3.35, abs=0.005)
    assert flipped.gains.kp == pytest.approx(0.543, abs=0.003)
    assert flipped.gains.kd == pytest.approx(4.11, abs=0.02)
    assert flipped.gains.ksg == pytest.approx(0.222, abs=0.003)
    assert flipped.active == ("gain margin of model 3", "phase margin of model 3")


def test_tune_pdp___every_start___ends_at_the_same_gains(
    printed: PdpTuning, flipped: PdpTuning
) -> None:
    for tuning in (printed, flipped):
        assert len(tuning.searches) == 3
        assert all(search.feasible for search in tuning.searches)
        assert tuning.gain_spread < 0.005
        criteria = [search.criterion for search in tuning.searches]
        assert criteria == pytest.approx([tuning.criterion] * 3, rel=0.005)


def test_tune_pdp___certificate___is_what_its_parts_say(flipped: PdpTuning) -> None:
    for reported, model in zip(flipped.margins, FLIPPED_MODELS, strict=True):
        assert _figures(reported) == pytest.approx(
            _figures(margins(model, flipped.gains)), rel=1e-6
        )
    assert all(found.gain_margin_db > 9.99 for found in flipped.margins)
    assert all(found.phase_margin_deg > 54.99 for found in flipped.margins)
    parts = 0.5 * sum(flipped.error_itae) + 0.5 * sum(flipped.strain_itae)
    assert flipped.criterion == pytest.approx(parts)
    stepped = _stepped_criterion(FLIPPED_MODELS, flipped.gains, 3.0)
    assert flipped.criterion == pytest.approx(stepped, rel=1e-9)


@pytest.mark.slow
def test_tune_pdp___feasible_neighbours___are_no_better(flipped: PdpTuning) -> None:
    best = np.array([flipped.gains.kp, flipped.gains.kd, flipped.gains.ksg])
    generator = np.random.default_rng(3)
    compared = 0
    for _ in range(60):
        gains = PdpGains(*(best * (1 + 0.03 * generator.standard_normal(3))).tolist())
        found = [margins(model, gains) for model in FLIPPED_MODELS[2:]]
        if all(m.gain_margin_db >= 10.0 and m.phase_margin_deg >= 55.0 for m in found):
            compared += 1
            assert _stepped_criterion(FLIPPED_MODELS, gains, 1.0) > flipped.criterion - 1e-4
    assert compared >= 5


def test_tune_pdp___delay___is_part_of_margins_and_responses() -> None:
    tuning = tune_pdp(PRINTED_MODELS[:1], delay_s=0.002, starts=[PdpGains(0.3, 1.0, 0.1)])

    (reported,) = tuning.margins
    expected = margins(PRINTED_MODELS[0], tuning.gains, delay_s=0.002)
    assert _figures(reported) == pytest.approx(_figures(expected), rel=1e-6)
    stepped = _stepped_criterion([delayed(PRINTED_MODELS[0], 0.002)], tuning.gains, 1.0)
    assert tuning.criterion == pytest.approx(stepped, rel=1e-9)


def test_tune_pdp___weights___move_the_optimum() -> None:
    starts, models = [PdpGains(0.3, 1.0, 0.1)], FLIPPED_MODELS[:1]
    accurate = tune_pdp(models, error_weight=0.9, strain_weight=0.1, starts=starts, duration_s=2.0)
    calm = tune_pdp(models, error_weight=0.0, strain_weight=1.0, starts=starts, duration_s=2.0)

    assert accurate.error_itae[0] < calm.error_itae[0]
    assert accurate.strain_itae[0] > calm.strain_itae[0]
    both = 0.9 * accurate.error_itae[0] + 0.1 * accurate.strain_itae[0]
    assert accurate.criterion == pytest.approx(both)
    assert calm.criterion == pytest.approx(calm.strain_itae[0])


def test_tune_pdp___bounds___hold_the_gains() -> None:
    tuning = tune_pdp(PRINTED_MODELS[:1], bounds=((0.1, 0.2), (3.0, 3.5), (0.0, 0.1)))

    assert 0.1 <= tuning.gains.kp <= 0.2
    assert 3.0 <= tuning.gains.kd <= 3.5
    assert "bound of kp" in tuning.active


def test_tune_pdp___margins_out_of_reach___is_refused() -> None:
    with pytest.raises(ControlError, match="no gains found with 59 dB and 120 deg"):
        tune_pdp(PRINTED_MODELS, gain_margin_db=59.0, phase_margin_deg=120.0)


@pytest.mark.parametrize(
    ("values", "match"),
    [
        ({"delay_s": 5.0}, "delay_s = 5 s; must be 0 to 0.05 s"),
        ({"delay_s": -0.001}, "delay_s = -0.001 s"),
        ({"delay_s": math.nan}, "delay_s = nan s"),
        ({"error_weight": 0.0, "strain_weight": 0.0}, "error_weight = 0 and strain_weight = 0"),
        ({"error_weight": math.nan}, "error_weight = nan"),
        ({"error_weight": -0.5}, "error_weight = -0.5"),
        ({"strain_weight": math.inf}, "strain_weight = inf"),
        ({"gain_margin_db": 0.0}, "gain_margin_db = 0 dB; must be above 0 and at most 60 dB"),
        ({"gain_margin_db": 60.1}, "gain_margin_db = 60.1 dB"),
        ({"gain_margin_db": math.nan}, "gain_margin_db = nan dB"),
        ({"phase_margin_deg": 0.0}, "phase_margin_deg = 0 deg; must be above 0 and below 180"),
        ({"phase_margin_deg": 180.0}, "phase_margin_deg = 180 deg"),
        ({"phase_margin_deg": math.inf}, "phase_margin_deg = inf deg"),
    ],
)
def test_tune_pdp___value_without_sense___is_refused_by_name(
    values: dict[str, Any], match: str
) -> None:
    with pytest.raises(ControlError, match=f"^{match}"):
        tune_pdp(PRINTED_MODELS, **values)


@pytest.mark.parametrize("delay_s", [5.0, -0.001, math.nan, math.inf])
def test_tune_pi___delay_without_sense___is_refused(delay_s: float) -> None:
    with pytest.raises(ControlError, match=r"^delay_s = .* s; must be 0 to 0\.05 s"):
        tune_pi(PRINTED_MODELS[0], delay_s=delay_s)


def test_tune_pdp___nothing_to_tune___is_refused() -> None:
    with pytest.raises(ControlError, match="at least one model"):
        tune_pdp([])
    with pytest.raises(ControlError, match="one starting point"):
        tune_pdp(PRINTED_MODELS, starts=[])


def test_tune_pdp___feedthrough___is_refused() -> None:
    model = control.StateSpace([[0.5]], [[1.0]], np.ones((4, 1)), np.ones((4, 1)), DT_S)

    with pytest.raises(ControlError, match="D is not zero"):
        tune_pdp([model])
    with pytest.raises(ControlError, match="D is not zero"):
        tune_pi(model)


@pytest.mark.parametrize("duration_s", [4.0, 5.0])
def test_tune_pi___no_payload___is_that_of_table_4_1(duration_s: float) -> None:
    tuning = tune_pi(nominal_model(0.0), duration_s=duration_s)

    # Table 4-1: 0.3998 and 0.4034; the criterion is flat in ki.
    assert 0.40 <= tuning.gains.kp <= 0.43
    assert 0.39 <= tuning.criterion <= 0.42


def test_tune_pi___every_start___ends_at_the_same_criterion() -> None:
    tuning = tune_pi(nominal_model(0.2), starts=[PiGains(0.1, 0.001), PiGains(1.5, 0.15)])

    values = [search.criterion for search in tuning.searches]
    assert values == pytest.approx([tuning.criterion] * 2, rel=1e-4)


def test_tune_pi___no_start___is_refused() -> None:
    with pytest.raises(ControlError, match="one starting point"):
        tune_pi(nominal_model(0.0), starts=[])

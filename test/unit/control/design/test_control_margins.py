"""Margins against recomputed figures, closed forms, and poles on the unit circle."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest

from flexarm_control import ControlError, Margins, PdpGains, margins, nominal_model
from flexarm_control.design.margins import Loop, margin_frequencies_hz
from flexarm_control.models.arm_model import delayed

DT_S = 1 / 300
TRIAL = PdpGains(0.5, 3.3, 0.07)
PRINTED = PdpGains(0.5935, 4.2664, 0.2538)
FLIPPED = PdpGains(0.5935, 4.2664, -0.2538)


@pytest.mark.parametrize(
    ("gains", "payload_kg", "gain_margin_db", "phase_margin_deg"),
    [
        (TRIAL, 0.0, 11.2, 69.9),
        (TRIAL, 0.2, 10.1, 67.3),
        (TRIAL, 0.4, 8.7, 56.2),
        (PRINTED, 0.0, 10.4, 72.0),
        (PRINTED, 0.2, 8.2, 70.0),
        (PRINTED, 0.4, 6.9, 59.9),
        (FLIPPED, 0.2, 10.4, 65.3),
        (FLIPPED, 0.4, 9.5, 53.4),
    ],
)
def test_margins___appendix_b___are_the_recomputed_figures(
    gains: PdpGains, payload_kg: float, gain_margin_db: float, phase_margin_deg: float
) -> None:
    found = margins(nominal_model(payload_kg), gains)

    assert found.gain_margin_db == pytest.approx(gain_margin_db, abs=0.1)
    assert found.phase_margin_deg == pytest.approx(phase_margin_deg, abs=0.5)
    assert found.stable


def test_margins___flipped_gauge_without_payload___the_third_mode_counts() -> None:
    found = margins(nominal_model(0.0), FLIPPED)

    near_1_hz = [c for c in found.phase_crossings if 0.2 < c.frequency_hz < 2.0]
    assert [c.margin for c in near_1_hz] == pytest.approx([11.7], abs=0.1)
    assert found.gain_crossings[0].margin == pytest.approx(69.6, abs=0.5)
    # The loop gain exceeds one again at the third mode, far less than 55 deg from -180 deg.
    assert found.gain_margin_hz == pytest.approx(45.8, abs=0.1)
    assert found.phase_margin_hz == pytest.approx(46.1, abs=0.1)
    assert found.phase_margin_deg < 30.0
    assert found.stable


def _radius_and_hz(
    model: control.StateSpace, position_gain: complex, gains: PdpGains
) -> tuple[np.ndarray, np.ndarray]:
    """Distance of every closed-loop pole from the unit circle, and its frequency."""
    feedback = np.array([[position_gain, 0.0, gains.ksg, gains.kd]])
    poles = np.linalg.eigvals(model.A - model.B @ feedback @ model.C)
    return np.abs(poles) - 1.0, np.angle(poles) / (2 * np.pi * model.dt)


@pytest.mark.parametrize("delay_s", [0.0, 0.001, 0.006])
@pytest.mark.parametrize("gains", [TRIAL, PRINTED, FLIPPED])
@pytest.mark.parametrize("payload_kg", [0.0, 0.2, 0.4])
def test_margins___used_up_at_a_crossing___put_a_pole_on_the_unit_circle(
    payload_kg: float, gains: PdpGains, delay_s: float
) -> None:
    model = nominal_model(payload_kg)
    late = delayed(model, delay_s)

    found = margins(model, gains, delay_s=delay_s)

    used_up = [(c.frequency_hz, 10 ** (c.margin / 20) + 0j) for c in found.phase_crossings] + [
        (c.frequency_hz, np.exp(-1j * np.radians(c.margin))) for c in found.gain_crossings
    ]
    assert len(used_up) >= 3
    for frequency_hz, factor in used_up:
        distance, pole_hz = _radius_and_hz(late, gains.kp * factor, gains)
        near = np.abs(np.abs(pole_hz) - frequency_hz) < 0.01 + 0.001 * frequency_hz
        assert np.min(np.abs(distance[near])) < 2e-5


def _loop_only(loop: control.StateSpace) -> control.StateSpace:
    """Arm whose position is the output of a loop, with no strain and no speed."""
    C = np.vstack([loop.C, np.zeros((3, loop.nstates))])
    return control.StateSpace(loop.A, loop.B, C, 0, loop.dt)


def _three_lags(gain: float = 1.0) -> control.StateSpace:
    plant = control.tf([gain], [1.0, 3.0, 2.0, 0.0])
    return control.sample_system(control.ss(plant), DT_S, method="zoh")


def _loop_margins(gain: float, **options: float) -> Margins:
    return margins(_loop_only(_three_lags(gain)), PdpGains(1.0, 0.0, 0.0), **options)


def test_margins___integrator_and_two_lags___are_the_closed_form() -> None:
    found = _loop_margins(1.0)

    # k / (s (s + 1) (s + 2)) reaches -180 deg at sqrt(2) rad/s with gain k / 6.
    assert found.gain_margin_db == pytest.approx(20 * math.log10(6), abs=0.1)
    assert found.gain_margin_hz == pytest.approx(math.sqrt(2) / (2 * math.pi), rel=5e-3)


def test_margins___arm___are_those_of_python_control_but_for_the_end_of_the_loop() -> None:
    model = nominal_model(0.2)
    omega = 2.0 * math.pi * margin_frequencies_hz(model)
    position, _, strain, speed = model(np.exp(1j * omega * model.dt))[:, 0]
    loop = PRINTED.kp * position / (1.0 + PRINTED.ksg * strain + PRINTED.kd * speed)
    factors, phases_deg, _, phase_crossings, gain_crossings, _ = control.stability_margins(
        (np.abs(loop), np.degrees(np.angle(loop)), omega), returnall=True
    )

    found = margins(model, PRINTED)

    # The loop ends on the negative axis at half the sampling rate, which python-control leaves out.
    *crossings, end = found.phase_crossings
    assert end.frequency_hz == pytest.approx(150.0)
    for ours, theirs, crossed in (
        (crossings, 20.0 * np.log10(factors), phase_crossings),
        (found.gain_crossings, phases_deg, gain_crossings),
    ):
        assert [each.margin for each in ours] == pytest.approx(theirs.tolist(), abs=5e-3)
        places_hz = (crossed / (2.0 * math.pi)).tolist()
        assert [each.frequency_hz for each in ours] == pytest.approx(places_hz, rel=1e-3)


def test_margins___too_much_gain___are_negative() -> None:
    found = _loop_margins(12.0)

    assert not found.stable
    assert found.gain_margin_db == pytest.approx(-20 * math.log10(2), abs=0.1)
    assert found.phase_margin_deg < 0.0


def test_margins___delay___takes_phase_in_proportion() -> None:
    prompt, late = _loop_margins(1.0), _loop_margins(1.0, delay_s=0.005)

    taken_deg = prompt.phase_margin_deg - late.phase_margin_deg
    assert taken_deg == pytest.approx(360 * prompt.phase_margin_hz * 0.005, rel=1e-3)


def test_margins___crossing_below_the_limit___does_not_count() -> None:
    # The gain crosses one at 0.07 Hz only: the limit hides no other, so it counts.
    assert _loop_margins(1.0, lowest_hz=0.2).phase_margin_hz == pytest.approx(0.071, abs=1e-3)

    hidden = _loop_margins(1.0, lowest_hz=0.5)

    assert hidden.gain_margin_db == math.inf
    assert math.isnan(hidden.gain_margin_hz)
    assert [c.frequency_hz for c in hidden.phase_crossings] == pytest.approx([0.225], abs=1e-3)


def test_margins___alternating_pole___ends_at_half_the_sampling_rate() -> None:
    # The loop 0.1 / (z + 0.5) is -0.2 at z = -1 and nowhere else real and negative.
    loop = control.StateSpace([[-0.5]], [[1.0]], [[0.1]], 0, DT_S)

    found = margins(_loop_only(loop), PdpGains(1.0, 0.0, 0.0))

    assert found.gain_margin_db == pytest.approx(20 * math.log10(5))
    assert found.gain_margin_hz == pytest.approx(150.0)
    assert len(found.phase_crossings) == 1
    assert found.gain_crossings == ()
    assert found.phase_margin_deg == math.inf


@pytest.mark.parametrize(("share", "stable"), [(0.1, True), (0.99, True), (1.01, False)])
def test_margins___feedthrough___is_part_of_the_loop(share: float, stable: bool) -> None:  # noqa: FBT001
    # y = x + u with x(k+1) = 0.5 x + 2 u: the pole 0.5 - 2 g / (1 + g) passes -1 at g = 3.
    # With y = x - u / 3 it is 0.5 - 2 g / (1 - g / 3) and passes -1 at g = 0.6.
    C = [[1.0], [0.0], [0.0], [0.0]]
    towards = control.StateSpace([[0.5]], [[2.0]], C, [[1.0], [0.0], [0.0], [0.0]], DT_S)
    against = control.StateSpace([[0.5]], [[2.0]], C, [[-1 / 3], [0.0], [0.0], [0.0]], DT_S)

    assert margins(towards, PdpGains(3.0 * share, 0.0, 0.0)).stable is stable
    assert margins(against, PdpGains(0.6 * share, 0.0, 0.0)).stable is stable


def test_disk_margin___integrator_and_two_lags___agrees_with_the_control_package() -> None:
    omega = np.geomspace(0.1, 10.0, 500)
    disk, _, _ = control.disk_margins(_three_lags(4.0), omega, skew=0.0)

    found = _loop_margins(4.0, lowest_hz=1e-4)

    assert found.disk_margin == pytest.approx(disk, rel=1e-3)


@pytest.mark.parametrize("payload_kg", [0.0, 0.2, 0.4])
def test_disk_margin___every_factor_in_the_disk___keeps_the_loop_stable(payload_kg: float) -> None:
    model = nominal_model(payload_kg)
    found = margins(model, TRIAL)
    a = found.disk_margin / 2.0

    for angle in np.linspace(0.0, 2.0 * np.pi, 33):
        for size, stable in ((0.98, True), (1.0, None)):
            delta = size * a * np.exp(1j * angle)
            distance, pole_hz = _radius_and_hz(
                model, TRIAL.kp * (1.0 + delta) / (1.0 - delta), TRIAL
            )
            # The printed slow poles lie outside from the start, below where crossings count.
            assert stable is None or np.max(distance[np.abs(pole_hz) > 0.2]) < 0.0


def test_disk_margin___unstable_loop___is_zero() -> None:
    found = _loop_margins(12.0)

    assert found.disk_margin == 0.0


def test_margins___model_of_another_plant___is_refused() -> None:
    with pytest.raises(ControlError, match="inputs: 1, outputs: 1"):
        margins(_three_lags(), TRIAL)


def test_margins___negative_delay___is_refused() -> None:
    with pytest.raises(ControlError, match="delay_s = -1"):
        margins(nominal_model(0.0), TRIAL, delay_s=-1.0)


FREQUENCIES_HZ = margin_frequencies_hz(control.StateSpace([[0.0]], [[1.0]], [[1.0]], 0, DT_S))


def of_response(loop: np.ndarray) -> Margins:
    """Return the margins of a loop by its response."""
    return Loop(FREQUENCIES_HZ, loop, np.ones_like(loop), stable=True).margins()


def test_two_crossovers_below_the_limit___the_last_one_counts() -> None:
    # The gain 4 x / (1 + x^2) is one at x = 2 -+ sqrt(3), and the phase margin grows with x.
    x = FREQUENCIES_HZ / 0.02
    margin_deg = 30.0 + 20.0 * np.log10(x)

    found = of_response(-4.0 * x / (1.0 + x**2) * np.exp(1j * np.radians(margin_deg)))

    last = 2.0 + math.sqrt(3.0)
    assert len(found.gain_crossings) == 2
    assert found.phase_margin_hz == pytest.approx(0.02 * last, rel=1e-3)
    assert found.phase_margin_deg == pytest.approx(30.0 + 20.0 * math.log10(last), abs=0.1)


def test_disk_margin___response_below_the_limit___does_not_count() -> None:
    found = of_response(np.where(FREQUENCIES_HZ < 0.2, -0.9, -0.5).astype(complex))

    assert found.disk_margin == pytest.approx(2.0 * 0.5 / 1.5)
    assert found.disk_margin_hz >= 0.2


@pytest.mark.parametrize("crosses_before", [False, True])
def test_end_on_the_axis___is_one_crossing_beside_those_before(*, crosses_before: bool) -> None:
    # The phase rises to -180 deg at half the sampling rate, maybe after a crossing on its way.
    share = FREQUENCIES_HZ / FREQUENCIES_HZ[-1]
    phase = -np.pi - (1.0 - share) * (share - 0.5 if crosses_before else 1.0)
    loop = 0.25 * np.exp(1j * phase)
    loop[-1] = -0.25

    for response in (loop, loop.conj()):
        found = of_response(response)

        places_hz = [75.0, 150.0] if crosses_before else [150.0]
        crossings_hz = [each.frequency_hz for each in found.phase_crossings]
        assert crossings_hz == pytest.approx(places_hz, rel=1e-3)
        assert found.gain_margin_db == pytest.approx(20 * math.log10(4), abs=1e-3)

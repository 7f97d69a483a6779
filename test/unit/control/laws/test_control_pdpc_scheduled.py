"""The gain schedule, and the law that follows it on the simulated rig."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_control.design.criteria import step_figures
from flexarm_control.design.margins import LoopResponse
from flexarm_control.design.tuning import tune_pdp
from flexarm_control.laws.gains import Compensation, PdpGains
from flexarm_control.laws.payload import PayloadDetection
from flexarm_control.laws.pdpc import Pdpc
from flexarm_control.laws.pdpc_scheduled import GainSchedule, ScheduledPdpc, ScheduleGains, between
from flexarm_control.models.nominal_models import nominal_model
from flexarm_control.simulation import simulate
from flexarm_core.errors import SettingError
from flexarm_daq import RigParameters, SimulatedRig

if TYPE_CHECKING:
    from flexarm_control.laws.law_protocol import Law

RATE_HZ = 300.0
ROBUST, FASTEST = ScheduleGains().robust, ScheduleGains().schedule


def scheduled() -> ScheduledPdpc:
    return ScheduledPdpc(ScheduleGains(), Compensation(), PayloadDetection())


def step_response(law: Law, payload_kg: float, setpoint_v: float) -> tuple[np.ndarray, np.ndarray]:
    """Position and command of a step of 3 s on the simulated rig, V."""
    rig = SimulatedRig(RigParameters(payload_kg=payload_kg), seed=3)
    run = simulate(rig, law, np.full(round(3.0 * RATE_HZ), setpoint_v))
    return run.y[:, 0], run.command_v


@given(st.floats(-1.0, 2.0))
def test_gains_between_payloads___are_those_of_linear_interpolation(payload_kg: float) -> None:
    gains = FASTEST.at(payload_kg)

    for name in ("kp", "kd", "ksg"):
        nodes = [getattr(each, name) for each in FASTEST.gains]
        assert getattr(gains, name) == pytest.approx(
            np.interp(payload_kg, FASTEST.payloads_kg, nodes)
        )


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_gains_a_share_of_the_way___lie_there(share: float) -> None:
    gains = between(PdpGains(0.2, 2.0, -1.0), PdpGains(0.6, 4.0, 1.0), share)

    expected = (0.2 + 0.4 * share, 2.0 + 2.0 * share, -1.0 + 2.0 * share)
    assert (gains.kp, gains.kd, gains.ksg) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("payloads_kg", "count", "complaint"),
    [
        ((), 0, "as many payloads as gains, got 0 and 0"),
        ((0.0, 0.2), 1, "as many payloads as gains, got 2 and 1"),
        ((0.2, 0.2), 2, "must increase"),
    ],
)
def test_schedule_that_does_not_fit___is_refused(
    payloads_kg: tuple[float, ...], count: int, complaint: str
) -> None:
    with pytest.raises(SettingError, match=complaint):
        GainSchedule(payloads_kg, (PdpGains(),) * count)


@pytest.mark.slow
def test_robust_gains___are_those_of_the_tuning() -> None:
    tuned = tune_pdp([nominal_model(payload_kg) for payload_kg in FASTEST.payloads_kg]).gains

    assert (ROBUST.kp, ROBUST.kd) == pytest.approx((tuned.kp, tuned.kd), abs=0.005)
    assert ROBUST.ksg == pytest.approx(tuned.ksg, abs=0.005)


def test_scheduled_gains___keep_the_margins_of_the_robust_ones() -> None:
    for payload_kg, gains in zip(FASTEST.payloads_kg, FASTEST.gains, strict=True):
        margins = LoopResponse(nominal_model(payload_kg)).margins(gains)

        assert margins.gain_margin_db >= 10.0
        assert margins.phase_margin_deg >= 55.0


def test_scheduled_law___starts_with_the_robust_gains_and_forgets_on_reset() -> None:
    law, robust = scheduled(), Pdpc(ROBUST)
    at_rest = (0.0, 0.0, 0.0, 0.0)
    first = [law.step(at_rest, 3.0) for _ in range(50)]
    assert first == [robust.step(at_rest, 3.0)] * 50

    step_response(law, 0.0, 3.0)
    assert law.payload.detected
    law.reset()
    assert not law.payload.detected
    assert law.step(at_rest, 3.0) == robust.step(at_rest, 3.0)


def test_scheduled_law___settles_faster_without_a_jump_of_the_command() -> None:
    time_s = np.arange(round(3.0 * RATE_HZ)) / RATE_HZ
    fixed, fixed_command_v = step_response(Pdpc(ROBUST), 0.0, 3.0)
    follows, command_v = step_response(scheduled(), 0.0, 3.0)

    settled_s = step_figures(time_s, follows, 3.0).settling_s
    assert settled_s <= 0.85 * step_figures(time_s, fixed, 3.0).settling_s
    jump_v, fixed_jump_v = (np.max(np.abs(np.diff(u))) for u in (command_v, fixed_command_v))
    assert jump_v <= fixed_jump_v + 0.1

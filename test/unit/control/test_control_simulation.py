"""Closed-loop simulation against the control package and against its own linear form."""

from __future__ import annotations

from typing import TYPE_CHECKING

import control
import numpy as np
import pytest

from flexarm_control import (
    Compensation,
    ControlError,
    Effort,
    Pdp,
    Pdpc,
    PdpGains,
    PiGains,
    nominal_model,
    simulate_loop,
)
from flexarm_control.design.tuning import pdp_step_response, pi_step_response
from flexarm_control.models.arm_model import delayed

if TYPE_CHECKING:
    from collections.abc import Sequence

GAINS = PdpGains(0.5, 3.3, 0.07)
DT_S = 1 / 300


def _closed_by_control(model: control.StateSpace, gains: PdpGains) -> control.StateSpace:
    """Negative feedback of kp, ksg and kd by the control package's own algebra."""
    gain = np.array([[gains.kp, 0.0, gains.ksg, gains.kd]])
    feedback = control.StateSpace([], [], [], gain, model.dt)
    return control.feedback(model, feedback) * gains.kp


@pytest.mark.parametrize("payload_kg", [0.0, 0.2, 0.4])
@pytest.mark.parametrize("delay_s", [0.0, 0.001])
def test_simulate_loop___pdp_step___agrees_with_the_control_package(
    payload_kg: float, delay_s: float
) -> None:
    model = delayed(nominal_model(payload_kg), delay_s)
    reference_v = np.full(900, 3.0)

    run = simulate_loop(model, Pdp(GAINS), reference_v)

    expected = control.forced_response(_closed_by_control(model, GAINS), run.time_s, reference_v)
    assert np.allclose(run.y, expected.outputs.T, atol=1e-9)
    assert run.time_s[1] == pytest.approx(DT_S)
    effort_v = 0.5 * (3.0 - run.y[:, 0]) - 3.3 * run.y[:, 3] - 0.07 * run.y[:, 2]
    assert np.allclose(run.effort, effort_v)
    assert not run.compensation.any()


def test_simulate_loop___pdpc___records_the_compensation_but_does_not_apply_it() -> None:
    model, reference_v = nominal_model(0.0), np.full(1500, 1.0)

    with_it = simulate_loop(model, Pdpc(GAINS, Compensation(0.7)), reference_v)
    without = simulate_loop(model, Pdp(GAINS), reference_v)

    np.testing.assert_allclose(with_it.y, without.y, rtol=0.0, atol=1e-9)
    assert set(np.unique(with_it.compensation)) <= {-0.7, 0.0, 0.7}
    assert with_it.compensation[0] == 0.7


class _Counter:
    """Effort that counts the samples since the last reset."""

    def __init__(self) -> None:
        self.count = 0.0

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        assert len(volts) == 4
        self.count += 1.0
        return Effort(self.count + reference_v, 0.0)

    def reset(self) -> None:
        self.count = 0.0


def test_simulate_loop___law_with_state___is_reset_first() -> None:
    law, reference_v = _Counter(), np.array([0.0, 10.0, 0.0])

    runs = [simulate_loop(nominal_model(0.0), law, reference_v) for _ in range(2)]

    assert [run.effort.tolist() for run in runs] == [[1.0, 12.0, 3.0]] * 2


def test_simulate_loop___feedthrough___is_refused() -> None:
    model = control.StateSpace([[0.5]], [[1.0]], np.ones((4, 1)), np.ones((4, 1)), DT_S)

    with pytest.raises(ControlError, match="state a loop delay"):
        simulate_loop(model, Pdp(), np.ones(3))


@pytest.mark.parametrize("samples", [2, 3, 64, 1500])
def test_pdp_step_response___any_length___is_that_of_python_control(samples: int) -> None:
    model = nominal_model(0.4)

    expected = control.forced_response(_closed_by_control(model, GAINS), inputs=np.ones(samples))

    response = pdp_step_response(model, GAINS, samples)
    assert np.allclose(response, expected.outputs.T, atol=1e-9)


class _Pi:
    """PI law written as a sum, apart from the linear form under test."""

    def __init__(self, kp: float, ki: float) -> None:
        self.kp, self.ki = kp, ki
        self.errors: list[float] = []

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        self.errors.append(reference_v - volts[0])
        return Effort(self.kp * self.errors[-1] + self.ki * DT_S * sum(self.errors), 0.0)

    def reset(self) -> None:
        self.errors.clear()


def test_pi_step_response___step___is_the_stepped_loop() -> None:
    model = nominal_model(0.0)

    run = simulate_loop(model, _Pi(0.4, 0.1), np.ones(900))

    assert np.allclose(pi_step_response(model, PiGains(0.4, 0.1), 900), run.y, atol=1e-9)


def test_disturbance___is_answered_as_the_closed_loop_answers_it() -> None:
    model = nominal_model(0.2)

    run = simulate_loop(model, Pdp(GAINS), np.zeros(600), disturbance_v=0.3)

    closed = _closed_by_control(model, GAINS)
    _, expected = control.forced_response(closed, U=np.full(600, 0.3 / GAINS.kp))
    np.testing.assert_allclose(run.y, expected.T, atol=1e-9)

"""The law pdpc_plus: its states, and its rest on the simulated rig beside that of PDPC."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexarm_control import Compensation, Pdpc, PdpcPlus, PdpGains, step_figures
from flexarm_control.laws.gains import CompensationLevel
from flexarm_control.laws.pdpc_plus import Rest
from flexarm_control.simulation import simulate
from flexarm_daq import RigParameters, SimulatedRig
from support.exhaustive import first_of

RATE_HZ = 300.0
TUNED = PdpGains(0.4903, 4.3329, 0.005)
POSITION_ONLY = PdpGains(1.0, 0.0, 0.0)
REST = Rest(rest_error_v=0.02, error_hysteresis_v=0.02, rest_speed_v=0.05, speed_hysteresis_v=0.05)


def _step_arm(
    law: Pdpc | PdpcPlus, payload_kg: float, setpoint_v: float
) -> tuple[np.ndarray, np.ndarray]:
    """Measured position, and base strain without noise."""
    rig = SimulatedRig(RigParameters(payload_kg=payload_kg), seed=3)
    run = simulate(rig, law, np.full(3000, setpoint_v), true_outputs=rig.outputs_v)
    return run.y[:, 0], run.true_y[:, 1]


@pytest.mark.parametrize(
    ("payload_kg", "setpoint_v"), first_of([(0.0, 1.0), (0.2, 3.0), (0.3, 4.0), (0.4, 5.0)], 2)
)
def test_rest___on_the_rig___is_calmer_than_that_of_pdpc(
    payload_kg: float, setpoint_v: float
) -> None:
    plain = Pdpc(TUNED, Compensation(error_threshold_v=0.025, speed_threshold_v=0.08))

    position_v, strain_v = _step_arm(PdpcPlus(TUNED), payload_kg, setpoint_v)
    _, plain_strain_v = _step_arm(plain, payload_kg, setpoint_v)

    figures = step_figures(np.arange(3000) / RATE_HZ, position_v, setpoint_v)
    assert abs(figures.mean_error_v) <= 0.05
    assert figures.overshoot <= 0.06
    assert figures.settling_s <= (3.5 if payload_kg == 0.0 else 2.0)
    # Both from when every trial has settled, 3 s.
    assert np.std(strain_v[900:]) <= 0.7 * np.std(plain_strain_v[900:])


def test_way___is_that_of_pdpc() -> None:
    law, plain = PdpcPlus(TUNED), Pdpc(TUNED)
    generator = np.random.default_rng(0)

    for volts in generator.uniform(-0.2, 0.2, (50, 4)).tolist():
        assert law.step(volts, 2.0) == plain.step(volts, 2.0)


def test_rest___begins_and_ends_with_a_hysteresis() -> None:
    law = PdpcPlus(POSITION_ONLY, CompensationLevel(0.7), REST)

    def compensation_v(error_v: float) -> float:
        for _ in range(100):
            effort = law.step((0.0, 0.0, 0.0, 0.0), error_v)
        return abs(effort.compensation_v)

    assert compensation_v(0.03) == 0.7
    assert compensation_v(0.019) == 0.0
    assert compensation_v(0.03) == 0.0
    assert compensation_v(0.041) == 0.7


def test_rest___one_spike_of_the_tachometer___does_not_end_it() -> None:
    law = PdpcPlus(POSITION_ONLY, CompensationLevel(0.7), REST)
    law.step((0.0, 0.0, 0.0, 0.0), 0.0)

    assert law.step((0.0, 0.0, 0.0, 0.12), 0.0).compensation_v == 0.0
    for _ in range(100):
        moving = law.step((0.0, 0.0, 0.0, 0.12), 0.0)
    assert moving.compensation_v == 0.7


@pytest.mark.parametrize("strain_v", [-2.0, -0.2, -0.1, 0.0, 0.1, 0.2, 2.0])
def test_rest___bent_arm___is_helped_to_turn_the_motor(strain_v: float) -> None:
    law = PdpcPlus(POSITION_ONLY, CompensationLevel(0.7), Rest(release_v=0.5, release_strain_v=0.2))
    for _ in range(200):
        effort = law.step((1.0, strain_v, 0.0, 0.0), 1.0)

    assert effort.effort_v == 0.0
    helped_v = -math.copysign(0.5 * min(1.0, abs(strain_v) / 0.2), strain_v)
    assert effort.compensation_v == pytest.approx(helped_v, abs=1e-6)


def test_reset___forgets_the_rest() -> None:
    law = PdpcPlus(POSITION_ONLY, CompensationLevel(0.7), REST)
    for _ in range(50):
        law.step((0.0, 1.0, 0.0, 0.0), 0.0)

    law.reset()

    fresh = PdpcPlus(POSITION_ONLY, CompensationLevel(0.7), REST)
    assert law.step((0.0, 0.0, 0.0, 0.0), 0.03) == fresh.step((0.0, 0.0, 0.0, 0.0), 0.03)

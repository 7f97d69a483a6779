"""Trajectories of references beside the plans of single moves."""

from __future__ import annotations

import numpy as np
import pytest

from flexarm_control.laws.law_protocol import Effort
from flexarm_control.learning.trajectory import (
    Trajectory,
    bending_hub,
    planned_trajectory,
    unit_move,
)
from flexarm_control.planning.flat_arm import ArmFigures
from flexarm_core.errors import SettingError
from flexarm_daq import RigParameters, SimulatedRig

RATE_HZ = 300.0
ARM = ArmFigures().at(0.2)
PEAK_V = 6.0


def test_trajectory___of_a_step___is_the_shortest_move_within_the_peak() -> None:
    found = planned_trajectory(np.full(10, 2.0), ARM, PEAK_V, RATE_HZ)

    samples = len(found) - 309
    expected = 2.0 * unit_move(ARM, samples, RATE_HZ)
    signals = (found.position_v, found.middle_strain_v, found.speed_v, found.command_v)
    np.testing.assert_allclose(np.array(signals)[:, :samples], expected, atol=1e-6)
    np.testing.assert_allclose(found.position_v[samples:], 2.0, atol=1e-9)
    assert found.end_v == pytest.approx(2.0)
    assert np.abs(found.command_v).max() <= PEAK_V
    shorter_v = 2.0 * unit_move(ARM, samples - 1, RATE_HZ)[-1]
    assert np.abs(shorter_v).max() > PEAK_V


def test_trajectory___of_steps_that_overlap___keeps_the_peak() -> None:
    reference_v = np.repeat([1.0, -1.0, 2.0], 20)

    found = planned_trajectory(reference_v, ARM, PEAK_V, RATE_HZ)

    assert np.abs(found.command_v).max() <= PEAK_V
    assert np.abs(found.position_v).max() <= 2.5


def test_trajectory___of_a_hub_that_bends___is_that_of_a_rig_without_friction() -> None:
    rig = SimulatedRig(
        RigParameters(payload_kg=0.4, coulomb_friction_nm=0.0, backlash_deg=0.0),
        rate_hz=RATE_HZ,
        seed=0,
    )
    figures = ArmFigures().at(0.4)
    asked = planned_trajectory(np.full(10, 3.0), bending_hub(figures), PEAK_V, RATE_HZ)

    rig.open()
    outputs_v = []
    for command_v in asked.command_v.tolist():
        rig.read()
        outputs_v.append(rig.outputs_v())
        rig.write([sum(Effort(command_v, 0.0))])

    moved = len(asked) - 310
    left_v = (asked.position_v - np.array(outputs_v)[:, 0])[:moved]
    one_mode = planned_trajectory(np.full(10, 3.0), figures, PEAK_V, RATE_HZ)
    without_v = (one_mode.position_v - np.array(outputs_v)[:, 0])[:moved]
    assert np.abs(left_v).max() <= 0.4 * np.abs(without_v).max()


@pytest.mark.parametrize(
    ("reference_v", "complaint"),
    [
        ([], "must have samples"),
        ([0.0, np.nan], "all must be finite"),
        ([0.0, 99.0], "above 6 V|leaves the travel"),
    ],
)
def test_trajectory___of_no_reference___is_refused(
    reference_v: list[float], complaint: str
) -> None:
    with pytest.raises(SettingError, match=complaint):
        planned_trajectory(np.array(reference_v), ARM, PEAK_V, RATE_HZ)


def test_trajectory___signals_of_two_lengths___is_refused() -> None:
    some = np.zeros(3)
    with pytest.raises(SettingError, match="speed_v must have a value for every sample"):
        Trajectory(RATE_HZ, some, some, some[:2], some)

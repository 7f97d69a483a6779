"""Packaged models of the rig beside its equations in continuous time."""

from __future__ import annotations

import numpy as np
import pytest

from flexarm_control.models.nominal_models import nominal_payloads_kg, rig_model
from flexarm_daq import RigParameters
from flexarm_daq.rigs.plant import Plant, simulate


@pytest.mark.parametrize("payload_kg", nominal_payloads_kg())
def test_rig_model___answers_as_the_rig_without_friction_and_gap(payload_kg: float) -> None:
    rig = RigParameters(
        payload_kg=payload_kg, coulomb_friction_nm=0.0, backlash_deg=0.0, loop_delay_s=0.0
    )
    time_s = np.arange(600) / 300.0
    # To and fro and still again, up to 16 Hz.
    command_v = np.sin(2.0 * np.pi * 4.0 * time_s**2) * np.sin(0.5 * np.pi * time_s) ** 2
    measured = simulate(Plant(rig), command_v, 300.0)
    model, state, found = rig_model(payload_kg), np.zeros(8), []

    for volts in command_v:
        found.append(model.C @ state)
        state = model.A @ state + model.B[:, 0] * volts

    missed = np.linalg.norm(np.array(found) - measured, axis=0) / np.linalg.norm(measured, axis=0)
    # The filter of the tachometer is in the model only as far as its modes have it.
    np.testing.assert_array_less(missed, [0.02, 0.08, 0.05, 0.2])

"""Rigid motion and bending modes of a model: known ones, in a form that hides them."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.linalg import block_diag

from flexarm_control.models.arm_model import OUTPUTS
from flexarm_control.models.nominal_models import nominal_model
from flexarm_control.models.rigid_and_bending import design_model
from flexarm_core.errors import SettingError
from flexarm_ident.fitting.validation import frequency_response

DT_S = 1.0 / 300.0
MODES_HZ = (8.0, 22.0)
TIME_CONSTANT_S = 0.6


def pair(frequency_hz: float, damping_ratio: float) -> np.ndarray:
    """Block with the sampled poles of an oscillator."""
    rate = 2.0 * np.pi * frequency_hz * (-damping_ratio + 1j * np.sqrt(1.0 - damping_ratio**2))
    pole = np.exp(rate * DT_S)
    return np.array([[pole.real, -pole.imag], [pole.imag, pole.real]])


def arm(
    integrator: float = 1.0, *, damping_ratio: float = 0.03, extra: tuple[float, ...] = ()
) -> control.StateSpace:
    """Model with a known rigid motion and two modes, its states mixed."""
    slow = np.exp(-DT_S / TIME_CONSTANT_S)
    bending = [pair(frequency_hz, damping_ratio) for frequency_hz in MODES_HZ]
    a = block_diag([[integrator]], [[slow]], *bending, *([[each]] for each in extra))
    order = len(a)
    b = np.ones((order, 1))
    c = np.zeros((4, order))
    c[0, :6] = [0.03, -0.03, 0.001, 0.002, -0.001, 0.0005]
    c[1, 1:6] = [0.002, 0.05, -0.04, 0.02, 0.03]
    c[2, 1:6] = [0.001, -0.03, 0.02, 0.04, 0.01]
    c[3, 1:6] = [0.03, 0.004, -0.002, 0.003, 0.002]
    c[:, 6:] = 1e-4
    mixed = np.random.default_rng(4).normal(size=(order, order)) + 3.0 * np.eye(order)
    inverse = np.linalg.inv(mixed)
    return control.StateSpace(
        mixed @ a @ inverse, mixed @ b, c @ inverse, 0.0, DT_S, outputs=list(OUTPUTS)
    )


def test_model_of_rigid_motion_and_bending___is_found_as_it_was_made() -> None:
    found = design_model(arm())

    assert found.modes_hz == pytest.approx(MODES_HZ)
    assert found.time_constant_s == pytest.approx(TIME_CONSTANT_S, rel=1e-3)
    assert max(found.missed) < 1e-3
    frequency_hz = np.geomspace(0.01, 149.0, 200)
    np.testing.assert_allclose(
        frequency_response(found.model, frequency_hz),
        frequency_response(arm(), frequency_hz),
        rtol=0.02,
        atol=1e-4,
    )


def test_output_that_the_rig_does_not_have___does_not_change_the_rigid_motion() -> None:
    without = arm()
    without.C[2] = 0.0
    found = design_model(without)

    assert found.time_constant_s == pytest.approx(TIME_CONSTANT_S, rel=1e-3)
    assert found.missed[2] == 0.0
    np.testing.assert_array_equal(found.model.C[2], 0.0)


@pytest.mark.parametrize("integrator", [0.9999, 0.9995])
def test_integrator_that_was_identified_inside_the_circle___is_one_again(integrator: float) -> None:
    found = design_model(arm(integrator, extra=(0.97, 0.5))).model

    poles = np.linalg.eigvals(found.A)
    assert np.min(np.abs(poles - 1.0)) < 1e-12
    assert found.nstates == 6
    hz = np.array([0.5, 1.0, 8.0, 22.0])
    np.testing.assert_allclose(
        np.abs(frequency_response(found, hz)[:, 0, 0]),
        np.abs(frequency_response(arm(), hz)[:, 0, 0]),
        rtol=0.1,
    )
    # What no constant speed moves has no part at the integrator.
    np.testing.assert_array_equal(found.C[1:, 0], 0.0)


@pytest.mark.parametrize(
    ("model", "complaint"),
    [
        (arm()[:2, :], "inputs: 1, outputs: 2"),
        (arm(damping_ratio=0.5), "no bending mode"),
        (nominal_model(0.2), "of the model's position_v is not that of a hub"),
        (arm() + control.StateSpace([], [], [], np.ones((4, 1)), DT_S), "D is not zero"),
    ],
)
def test_model_that_is_none_of_the_arm___is_refused_in_one_line(
    model: control.StateSpace, complaint: str
) -> None:
    with pytest.raises(SettingError, match=rf"{complaint}[^\n]*$"):
        design_model(model)

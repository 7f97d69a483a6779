from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from flexarm_core.errors import SettingError
from flexarm_daq.rigs.beam import arm_modes, carried_over, hub_beam_modes, natural_frequencies_hz
from flexarm_daq.rigs.rig_parameters import RigParameters
from support.rig_physics import arm_inertia_kg_m2

BARE = RigParameters(tip_mass_kg=0.0)


def characteristic(frequency_hz: float, hub_kg_m2: float, tip_kg: float) -> float:
    """Return the determinant of the boundary conditions of the exact beam.

    Deflection a sin + b sinh + c (cos - cosh) of beta x, on a beam of 1 m.
    """
    rig = RigParameters()
    omega_squared = (2.0 * np.pi * frequency_hz) ** 2
    stiffness = rig.bending_stiffness_nm2
    beta = (rig.mass_per_length_kg_per_m * omega_squared / stiffness) ** 0.25
    tip = tip_kg * omega_squared / (stiffness * beta**3)
    hub = hub_kg_m2 * omega_squared / (stiffness * beta)
    sin, cos, sinh, cosh = np.sin(beta), np.cos(beta), np.sinh(beta), np.cosh(beta)
    conditions = np.array(
        [
            [hub, hub, -2.0],
            [-sin, sinh, -cos - cosh],
            [-cos + tip * sin, cosh + tip * sinh, sin - sinh + tip * (cos - cosh)],
        ]
    )
    return float(np.linalg.det(conditions / [[1.0], [cosh], [cosh]]))


def exact_frequencies_hz(hub_kg_m2: float, tip_kg: float) -> list[float]:
    grid = np.arange(1.0, 60.0, 0.05)
    values = [characteristic(f, hub_kg_m2, tip_kg) for f in grid]
    return [
        brentq(characteristic, grid[i], grid[i + 1], args=(hub_kg_m2, tip_kg))
        for i in range(len(grid) - 1)
        if values[i] * values[i + 1] < 0.0
    ]


def test_modes___without_hub_and_tip___are_the_pinned_free_beam() -> None:
    # Roots of tan(x) = tanh(x).
    roots = np.array([3.92660231, 7.06858275, 10.21017612, 13.35176878])
    omega = roots**2 * np.sqrt(BARE.bending_stiffness_nm2 / BARE.mass_per_length_kg_per_m)
    modes = hub_beam_modes(BARE, hub_kg_m2=0.0, flexible=4)
    np.testing.assert_allclose(modes.omega_rad_per_s[1:], omega, rtol=1e-4)


@pytest.mark.parametrize("payload_kg", [0.0, 0.2, 0.3, 0.4])
def test_frequencies___with_hub_and_tip___solve_the_exact_beam(payload_kg: float) -> None:
    rig = RigParameters(payload_kg=payload_kg)
    hub_kg_m2 = rig.motor_inertia_kg_m2 + rig.load_inertia_kg_m2
    exact = exact_frequencies_hz(hub_kg_m2, rig.tip_mass_kg + payload_kg)
    np.testing.assert_allclose(natural_frequencies_hz(rig), exact, rtol=1e-4)


@pytest.mark.parametrize(
    ("payload_kg", "expected_hz", "tolerance"),
    [
        (0.0, (9.40, 24.08, 45.64), 0.005),
        # Published to two digits, by a coarser model in the third mode.
        (0.2, (7.4, 21.5, 40.8), 0.0075),
        (0.3, (7.1, 21.3, 40.5), 0.0075),
        (0.4, (7.0, 21.2, 40.3), 0.0080),
    ],
)
def test_frequencies___of_the_rig___are_its_true_modes(
    payload_kg: float, expected_hz: tuple[float, ...], tolerance: float
) -> None:
    frequencies_hz = natural_frequencies_hz(RigParameters(payload_kg=payload_kg))
    np.testing.assert_allclose(frequencies_hz, expected_hz, rtol=tolerance)


@pytest.mark.parametrize("count", [0, -1, 25])
def test_frequencies___beyond_the_mesh___are_refused(count: int) -> None:
    with pytest.raises(SettingError, match=r"^count must be between 1 and 24"):
        natural_frequencies_hz(RigParameters(), count)


def test_arm___rigid_mode___carries_the_inertia_of_the_load_side() -> None:
    rig = RigParameters(payload_kg=0.2)
    modes = arm_modes(rig)
    assert len(modes.omega_rad_per_s) == 7
    assert modes.omega_rad_per_s[0] == 0.0
    inertia = arm_inertia_kg_m2(rig)
    assert modes.hub_angle[0] == pytest.approx(inertia**-0.5)
    assert (modes.hub_angle > 0.0).all()


@pytest.mark.parametrize("payload_kg", [0.0, 0.4])
def test_gauges___under_a_steady_torque___read_the_moment_of_the_inertia_beyond(
    payload_kg: float,
) -> None:
    rig = RigParameters(payload_kg=payload_kg)
    modes = hub_beam_modes(rig, rig.load_inertia_kg_m2, flexible=40)
    acceleration = 1.0 / arm_inertia_kg_m2(rig)
    static = modes.hub_angle[1:] / modes.omega_rad_per_s[1:] ** 2
    for at_m, curvature in (
        (rig.base_gauge_at_m, modes.base_curvature),
        (rig.middle_gauge_at_m, modes.middle_curvature),
    ):
        x = np.linspace(at_m, 1.0, 2001)
        beam = np.trapezoid(rig.mass_per_length_kg_per_m * x * (x - at_m), x)
        tip = (rig.tip_mass_kg + payload_kg) * (1.0 - at_m)
        moment_nm = rig.bending_stiffness_nm2 * (curvature[1:] @ static)
        assert moment_nm == pytest.approx(-acceleration * (beam + tip), rel=0.01)


def test_modes___with_inertia_at_the_tip___keep_the_rigid_body_and_lower_the_others() -> None:
    rig = RigParameters(tip_inertia_kg_m2=1e-3)
    modes = arm_modes(rig)
    inertia = arm_inertia_kg_m2(rig)
    assert modes.hub_angle[0] == pytest.approx(inertia**-0.5)
    assert (natural_frequencies_hz(rig) < natural_frequencies_hz(RigParameters())).all()


def test_modes___carried_over_to_themselves___stay() -> None:
    modes = arm_modes(RigParameters(payload_kg=0.1))
    np.testing.assert_allclose(carried_over(modes, modes), np.eye(7), atol=1e-9)

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from flexarm_core.errors import SettingError
from flexarm_daq.rigs import plant as plant_module
from flexarm_daq.rigs.beam import arm_modes
from flexarm_daq.rigs.plant import Plant, simulate
from flexarm_daq.rigs.rig_parameters import RigParameters

RATE_HZ = 300.0
RIG = RigParameters(loop_delay_s=0.0)
LINEAR = replace(RIG, coulomb_friction_nm=0.0, backlash_deg=0.0, gear_damping_nm_s_per_rad=0.0)

Derivative = Callable[[float, NDArray[np.float64]], NDArray[np.float64]]


def wave(samples: int) -> NDArray[np.float64]:
    """Return a square wave of 0.6 s that keeps the arm between its stops."""
    time_s = np.arange(samples) / RATE_HZ
    return 2.0 * np.sign(np.sin(2.0 * np.pi * (time_s + 0.15) / 0.6))


def output_matrix(rig: RigParameters) -> NDArray[np.float64]:
    """Return the outputs over (motor angle, tacho, modes), then their velocities."""
    modes = arm_modes(rig)
    moment = rig.bending_stiffness_nm2
    matrix = np.zeros((4, 18))
    matrix[0, 2:9] = rig.position_gain_v_per_rad * modes.hub_angle
    matrix[1, 2:9] = -rig.base_gauge_v_per_nm * moment * modes.base_curvature
    matrix[2, 2:9] = rig.middle_gauge_v_per_nm * moment * modes.middle_curvature
    matrix[3, 1] = rig.tacho_gain_v_s_per_rad
    return matrix


def linear_model(rig: RigParameters) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return A and B of the rig without friction, gap and stops."""
    modes = arm_modes(rig)
    gear = np.zeros(9)
    gear[0], gear[2:] = 1.0, -modes.hub_angle
    push = np.zeros(9)
    push[0], push[2:] = -1.0 / rig.motor_inertia_kg_m2, modes.hub_angle
    cutoff = 2.0 * np.pi * rig.tacho_cutoff_hz
    omega_squared = modes.omega_rad_per_s**2
    stiffness = np.diag(np.r_[0.0, cutoff**2, omega_squared])
    stiffness -= rig.gear_stiffness_nm_per_rad * np.outer(push, gear)
    damping = np.diag(
        np.r_[
            rig.viscous_friction_nm_s_per_rad / rig.motor_inertia_kg_m2,
            2.0 * rig.tacho_damping_ratio * cutoff,
            rig.mass_damping_per_s + rig.stiffness_damping_s * omega_squared,
        ]
    )
    damping -= rig.gear_damping_nm_s_per_rad * np.outer(push, gear)
    damping[1, 0] = -(cutoff**2)
    system = np.block([[np.zeros((9, 9)), np.eye(9)], [-stiffness, -damping]])
    entry = np.zeros(18)
    entry[9] = rig.motor_gain_nm_per_v / rig.motor_inertia_kg_m2
    return system, entry


def exact_response(rig: RigParameters, command_v: NDArray[np.float64]) -> NDArray[np.float64]:
    system, entry = linear_model(rig)
    augmented = np.zeros((19, 19))
    augmented[:18, :18], augmented[:18, 18] = system, entry
    step = expm(augmented / RATE_HZ)
    output = output_matrix(rig)
    state = np.zeros(19)
    outputs = np.empty((len(command_v), 4))
    for k, volts in enumerate(command_v):
        outputs[k] = output @ state[:18]
        state[18] = volts
        state = step @ state
    return outputs


def smoothed_response(rig: RigParameters, command_v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the response by LSODA, with the sign of dry friction smoothed over 1 mrad/s."""
    modes = arm_modes(rig)
    gap = math.radians(rig.backlash_deg) / 2.0
    cutoff = 2.0 * np.pi * rig.tacho_cutoff_hz
    omega_squared = modes.omega_rad_per_s**2
    modal_damping = rig.mass_damping_per_s + rig.stiffness_damping_s * omega_squared

    def contact(depth: float, rate: float) -> float:
        torque = rig.gear_stiffness_nm_per_rad * depth + rig.gear_damping_nm_s_per_rad * rate
        return max(0.0, torque) if depth > 0.0 else 0.0

    def derivative(volts: float) -> Derivative:
        def evaluate(_time: float, state: NDArray[np.float64]) -> NDArray[np.float64]:
            position, velocity = state[:9], state[9:]
            twist = position[0] - modes.hub_angle @ position[2:]
            rate = velocity[0] - modes.hub_angle @ velocity[2:]
            torque = contact(twist - gap, rate) - contact(-twist - gap, -rate)
            stribeck = math.exp(-((velocity[0] / rig.stribeck_speed_rad_per_s) ** 2))
            friction = rig.coulomb_friction_nm * (1.0 + (rig.breakaway_ratio - 1.0) * stribeck)
            motor = (
                rig.motor_gain_nm_per_v * volts
                - rig.viscous_friction_nm_s_per_rad * velocity[0]
                - friction * math.tanh(velocity[0] / 1e-3)
                - torque
            ) / rig.motor_inertia_kg_m2
            tacho = cutoff**2 * (velocity[0] - position[1])
            tacho -= 2.0 * rig.tacho_damping_ratio * cutoff * velocity[1]
            arm = modes.hub_angle * torque
            arm -= modal_damping * velocity[2:] + omega_squared * position[2:]
            return np.concatenate([velocity, [motor, tacho], arm])

        return evaluate

    output = output_matrix(rig)
    state = np.zeros(18)
    outputs = np.empty((len(command_v), 4))
    for k, volts in enumerate(command_v):
        outputs[k] = output @ state
        solution = solve_ivp(
            derivative(volts), (0.0, 1.0 / RATE_HZ), state, "LSODA", rtol=1e-7, atol=1e-9
        )
        state = solution.y[:, -1]
    return outputs


def largest_error(actual: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Return the largest error of any channel, in parts of its range."""
    return float((np.abs(actual - expected).max(axis=0) / np.ptp(expected, axis=0)).max())


@pytest.mark.parametrize("payload_kg", [0.0, 0.4])
def test_response___of_the_linear_rig___is_the_matrix_exponential(payload_kg: float) -> None:
    rig = replace(LINEAR, payload_kg=payload_kg)
    command_v = wave(600)
    assert (
        largest_error(simulate(Plant(rig), command_v, RATE_HZ), exact_response(rig, command_v))
        < 1e-3
    )


@pytest.mark.slow
def test_response___of_the_whole_rig_over_3_s___agrees_with_lsoda() -> None:
    command_v = 1.25 * wave(900)
    outputs_v = simulate(Plant(RIG), command_v, RATE_HZ)
    assert largest_error(outputs_v, smoothed_response(RIG, command_v)) < 0.01


def test_response___with_smaller_intervals___converges() -> None:
    errors = []
    command_v = wave(300)
    expected = exact_response(LINEAR, command_v)
    for parts in (34, 68):
        plant = Plant(LINEAR)
        outputs = np.empty_like(expected)
        for k, volts in enumerate(command_v):
            outputs[k] = plant.outputs_v()
            for _ in range(parts):
                plant.advance(volts, 1.0 / RATE_HZ / parts)
        errors.append(largest_error(outputs, expected))
    # Second order: half the step, a quarter of the error.
    assert errors[1] / errors[0] == pytest.approx(0.25, abs=0.03)


def test_frequency_response___of_the_linear_rig___has_the_signs_of_appendix_b() -> None:
    system, entry = linear_model(RIG)
    s = 2j * np.pi * 4.0
    response = output_matrix(RIG) @ np.linalg.solve(s * np.eye(18) - system, entry)
    # The 0 g model of Appendix B at 4 Hz, between rigid motion and the first mode.
    assert abs(np.angle(response[1])) < np.radians(30.0)
    assert abs(np.angle(-response[2])) < np.radians(30.0)
    decibels = 20.0 * np.log10(np.abs(response[1:3]) / [0.839, 0.145])
    assert (np.abs(decibels) < 6.0).all()


def test_command___beyond_the_stall_torque_of_a_motor_without_a_gear___saturates() -> None:
    direct = replace(RIG, gear_ratio=1.0)
    stalled_v = direct.stall_torque_nm / direct.motor_gain_nm_per_v
    assert stalled_v == pytest.approx(5.34, abs=0.01)
    found, expected, geared = (
        simulate(Plant(rig), np.full(60, volts), RATE_HZ)
        for rig, volts in ((direct, 10.0), (direct, stalled_v), (RIG, 10.0))
    )
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert np.abs(geared - found).max() > 0.1


def test_command___beyond_full_scale___saturates() -> None:
    outputs_v = simulate(Plant(RIG), np.full(60, 25.0), RATE_HZ)
    np.testing.assert_array_equal(outputs_v, simulate(Plant(RIG), np.full(60, 10.0), RATE_HZ))


def test_simulate___in_two_parts___is_the_whole() -> None:
    rig = replace(RIG, loop_delay_s=0.001)
    command_v = wave(120)
    plant = Plant(rig)
    parts = [simulate(plant, command_v[:50], RATE_HZ), simulate(plant, command_v[50:], RATE_HZ)]
    whole = simulate(Plant(rig), command_v, RATE_HZ)
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@pytest.mark.slow
@pytest.mark.exhaustive
def test_response___of_the_plain_loop___is_that_of_the_compiled_one() -> None:
    script = (
        "import json, numpy as np\n"
        "from flexarm_daq.rigs.plant import Plant, simulate\n"
        "from flexarm_daq.rigs.rig_parameters import RigParameters\n"
        "u = 5.0 * np.sign(np.sin(np.arange(60) / 7.0))\n"
        "print(json.dumps(simulate(Plant(RigParameters()), u, 300.0).tolist()))\n"
    )
    path = plant_module.__file__.rsplit("/flexarm_daq/", 1)[0]
    outputs_v = [
        json.loads(
            subprocess.run(  # noqa: S603 - our own script
                [sys.executable, "-c", f"import sys; sys.path.insert(0, {path!r})\n{script}"],
                check=True,
                capture_output=True,
                env={**os.environ, "NUMBA_DISABLE_JIT": plain},
            ).stdout
        )
        for plain in ("0", "1")
    ]
    assert np.ptp(outputs_v[0], axis=0).min() > 0.1
    np.testing.assert_allclose(outputs_v[0], outputs_v[1], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("delay_s", [0.0, 0.001])
def test_simulate___with_a_delay___lets_each_command_act_late(delay_s: float) -> None:
    command_v = wave(90)
    plant = Plant(RIG)
    in_force_v = 0.0
    expected = []
    for volts in command_v:
        expected.append(plant.outputs_v())
        plant.advance(in_force_v, delay_s)
        in_force_v = volts
        plant.advance(in_force_v, 1.0 / RATE_HZ - delay_s)
    outputs_v = simulate(Plant(replace(RIG, loop_delay_s=delay_s)), command_v, RATE_HZ)
    np.testing.assert_allclose(outputs_v, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("command_v", "rate_hz", "delay_s", "message"),
    [
        (np.zeros((3, 1)), 300.0, 0.0, "command_v must have shape"),
        ([0.0, math.nan], 300.0, 0.0, "command_v must be finite"),
        ([0.0], 0.0, 0.0, "rate_hz must be positive"),
        ([0.0], math.nan, 0.0, "rate_hz must be positive"),
        ([0.0], 300.0, 1.0 / 300.0, "loop_delay_s must be less than the period"),
    ],
)
def test_simulate___bad_argument___is_refused(
    command_v: NDArray[np.float64], rate_hz: float, delay_s: float, message: str
) -> None:
    with pytest.raises(SettingError, match=message):
        simulate(Plant(replace(RIG, loop_delay_s=delay_s)), command_v, rate_hz)

"""Equations of motion of the rig: a motor and a flexible arm across a backlash.

Both bodies are referred to the arm's axis. The motor has inertia, viscous and dry friction. The arm
moves in its free modes `flexarm_daq.rigs.beam.arm_modes`. With the contact torque t_c, the stop
torque t_s and the modal hub angles phi_i::

    J_m theta_m'' = K_t sat(u) - b theta_m' - t_f - t_c
    q_i'' + (alpha + beta w_i^2) q_i' + w_i^2 q_i = phi_i (t_c + t_s),  theta_l = sum phi_i q_i

`flexarm_daq.rigs.integrator` solves them; `docs/rig.md` has them in full, with their sources.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.channels import CHANNELS
from flexarm_core.errors import SettingError
from flexarm_daq.rigs import integrator
from flexarm_daq.rigs.beam import TIP_DEFLECTION, BeamModes, arm_modes, carried_over
from flexarm_daq.rigs.equations import (
    ARM,
    COLUMNS,
    POSITION,
    RECORD,
    TACHO,
    Equations,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flexarm_daq.rigs.rig_parameters import RigParameters


class Plant:
    """Motion of the rig, noise-free and in continuous time.

    Parameters
    ----------
    parameters : RigParameters
        Rig.

    Attributes
    ----------
    parameters : RigParameters
        Rig with its present payload.
    command_v : float
        Command in force, V.
    state : ndarray, (2, COLUMNS)
        Positions and velocities (rows) of the motor (rad), the tachometer filter (rad/s) and the
        arm's mass-normalised modes, the rigid one first. Writable.
    """

    def __init__(self, parameters: RigParameters) -> None:
        self.command_v = 0.0
        self.state = np.zeros((2, COLUMNS))
        self._load(parameters)

    def reset(self) -> None:
        """Put the rig to rest at the middle of its travel."""
        self.command_v = 0.0
        self.state[:] = 0.0

    def change_payload(self, payload_kg: float) -> None:
        """Put another mass on the tip; the arm goes on from its present position and speed.

        Parameters
        ----------
        payload_kg : float
            Point mass at the tip, kg.

        Raises
        ------
        SettingError
            If the mass is negative or not finite.
        """
        before = self._modes
        self._load(replace(self.parameters, payload_kg=payload_kg))
        to_new = carried_over(before, self._modes)
        self.state[:, ARM:] = np.einsum("ij,kj", self.state[:, ARM:], to_new)

    def advance(self, command_v: float, interval_s: float) -> None:
        """Move on with a constant command.

        Parameters
        ----------
        command_v : float
            Command of the drive, V; beyond 10 V it saturates.
        interval_s : float
            Interval of any length, zero included, s.

        Raises
        ------
        SettingError
            If `command_v` is not finite, or `interval_s` is not finite or negative.
        """
        if not math.isfinite(command_v):
            raise SettingError(f"command_v must be finite, got {command_v}")
        if not 0.0 <= interval_s < math.inf:
            raise SettingError(f"interval_s must be finite and not negative, got {interval_s}")
        self.command_v = command_v
        integrator.advance(self.state, self._record, command_v, interval_s)

    def outputs_v(self) -> NDArray[np.float64]:
        """Return the four sensor voltages without noise or quantisation, V."""
        volts: NDArray[np.float64] = np.einsum(
            "ij,j", self._equations.output_rows, self.state[POSITION]
        )
        return volts

    def tip(self) -> tuple[float, float]:
        """Return direction and speed of the tip, seen from the axis, rad and rad/s."""
        at_tip = self._modes.shapes[TIP_DEFLECTION] / self.parameters.length_m
        angle, speed = np.einsum("ij,j", self.state[:, ARM:], at_tip)
        return float(angle), float(speed)

    def run(self, command_v: NDArray[np.float64], period_s: float) -> NDArray[np.float64]:
        """Sample and move on, one period per command; `simulate` checks and describes them."""
        outputs_v: NDArray[np.float64] = integrator.run(
            self.state,
            self._record,
            np.append(self.command_v, command_v),
            period_s,
            self.parameters.loop_delay_s,
        )
        self.command_v = float(command_v[-1]) if len(command_v) else self.command_v
        return outputs_v

    def _load(self, parameters: RigParameters) -> None:
        self.parameters = parameters
        self._modes = arm_modes(parameters)
        self._equations = equations_of(parameters, self._modes)
        self._record = np.array([self._equations], RECORD)


def simulate(plant: Plant, command_v: ArrayLike, rate_hz: float) -> NDArray[np.float64]:
    """Return the noise-free response of a rig to a given command, from its present state.

    Parameters
    ----------
    plant : Plant
        Rig; it is left at the end of the last period.
    command_v : array_like, (samples,)
        Commands, V. Command k acts from `loop_delay_s` of the parameters after sample k until the
        next one acts. Before the first, the command in force goes on.
    rate_hz : float
        Sampling rate, Hz.

    Returns
    -------
    ndarray, (samples, 4)
        Voltages in the order of `flexarm_core.channels.CHANNELS`; row k is sampled at k / rate_hz,
        before its command acts.

    Raises
    ------
    SettingError
        If the command is not one finite column, the rate is not positive or the loop delay is not
        within a period.

    Examples
    --------
    >>> from flexarm_daq.rigs.rig_parameters import RigParameters
    >>> simulate(Plant(RigParameters(payload_kg=0.2)), [0.0, 2.0, 2.0], 300.0).shape
    (3, 4)
    """
    commands_v = np.ascontiguousarray(command_v, dtype=np.float64)
    if commands_v.ndim != 1:
        raise SettingError(f"command_v must have shape (samples,), got {commands_v.shape}")
    if not np.isfinite(commands_v).all():
        raise SettingError("command_v must be finite throughout")
    if not 0.0 < rate_hz < math.inf:
        raise SettingError(f"rate_hz must be positive, got {rate_hz}")
    delay_s = plant.parameters.loop_delay_s
    if delay_s >= 1.0 / rate_hz:
        raise SettingError(
            f"loop_delay_s must be less than the period {1.0 / rate_hz:g} s, got {delay_s}"
        )
    return plant.run(commands_v, 1.0 / rate_hz)


def equations_of(parameters: RigParameters, modes: BeamModes) -> Equations:
    """Return the coefficients of a rig whose arm moves in some modes."""
    cutoff_rad_per_s = 2.0 * math.pi * parameters.tacho_cutoff_hz
    motor_damping = parameters.viscous_friction_nm_s_per_rad / parameters.motor_inertia_kg_m2
    tacho_damping = 2.0 * parameters.tacho_damping_ratio * cutoff_rad_per_s
    modal_stiffness = modes.omega_rad_per_s**2
    modal_damping = parameters.mass_damping_per_s + parameters.stiffness_damping_s * modal_stiffness
    return Equations(
        motor_inertia=parameters.motor_inertia_kg_m2,
        motor_gain=parameters.motor_gain_nm_per_v,
        largest_torque=parameters.stall_torque_nm * parameters.gear_ratio,
        coulomb_friction=parameters.coulomb_friction_nm,
        breakaway_excess=parameters.breakaway_ratio - 1.0,
        stribeck_speed=parameters.stribeck_speed_rad_per_s,
        half_gap=math.radians(parameters.backlash_deg) / 2.0,
        gear_stiffness=parameters.gear_stiffness_nm_per_rad,
        gear_damping=parameters.gear_damping_nm_s_per_rad,
        stop_angle=math.radians(parameters.stop_angle_deg),
        stop_stiffness=parameters.stop_stiffness_nm_per_rad,
        stop_damping=parameters.stop_damping_nm_s_per_rad,
        arm_mobility=float(np.sum(modes.hub_angle**2)),
        hub_angle=modes.hub_angle,
        stiffness=np.concatenate([[0.0, cutoff_rad_per_s**2], modal_stiffness]),
        damping=np.concatenate([[motor_damping, tacho_damping], modal_damping]),
        output_rows=_output_rows(parameters, modes),
    )


def _output_rows(parameters: RigParameters, modes: BeamModes) -> NDArray[np.float64]:
    stiffness_nm2 = parameters.bending_stiffness_nm2
    rows = np.zeros((len(CHANNELS), COLUMNS))
    rows[0, ARM:] = parameters.position_gain_v_per_rad * modes.hub_angle
    # An accelerating torque bends the beam to a negative curvature at both gauges; they are wired
    # so that it reads positive at the base and negative in the middle (Appendix B).
    rows[1, ARM:] = -parameters.base_gauge_v_per_nm * stiffness_nm2 * modes.base_curvature
    rows[2, ARM:] = parameters.middle_gauge_v_per_nm * stiffness_nm2 * modes.middle_curvature
    rows[3, TACHO] = parameters.tacho_gain_v_s_per_rad
    return rows

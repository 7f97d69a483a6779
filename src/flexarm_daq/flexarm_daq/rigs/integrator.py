"""Integrator of the rig's equations of motion, compiled.

A sub-step of at most 0.1 ms is split in the manner of Strang. In each half-step the modes, the
tachometer filter and the viscous motor move by their exact transition matrices. The torques act as
a kick between the two halves. The method is of second order where the torques are smooth.

A contact acts with its mean torque over the sub-step. This is a discrete gradient: its work is the
change of its elastic energy. Teeth and stops that meet within a sub-step therefore give no energy,
and take energy only by their damping. Dry friction is a constraint on the kicked speed, so a motor
below break-away stands still and does not creep.

The functions write arrays in place and check nothing; `flexarm_daq.rigs.plant.Plant` calls them for
one rig, `flexarm_daq.rigs.batch.RigBatch` for many.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.channels import MAX_COMMAND_V
from flexarm_core.compilation import compiled
from flexarm_daq.rigs.equations import ARM, COLUMNS, MODES, MOTOR, POSITION, TACHO, VELOCITY, Way

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_daq.rigs.equations import Equations

SUBSTEP_RATE_HZ = 10_000.0
"""Least rate of sub-steps: over 30 of them in the shortest period, that of the gear at 306 Hz."""

# Amplitudes below this count as rest. Denormal numbers would slow the processor.
_REST = 1e-100

_ROUNDS = 2
_STRIBECK_END = 6.5


@compiled
def run(
    state: NDArray[np.float64],
    record: NDArray[np.void],
    command_v: NDArray[np.float64],
    period_s: float,
    delay_s: float,
) -> NDArray[np.float64]:
    """Sample and move on, one period per command.

    Parameters
    ----------
    state : ndarray, (2, COLUMNS)
        Positions and velocities, changed in place.
    record : ndarray of RECORD, (1,)
        `Equations`.
    command_v : ndarray, (1 + samples,)
        Command in force, then one for each sample, V.
    period_s, delay_s : float
        Time between samples, and from a sample to its command, s.

    Returns
    -------
    ndarray, (samples, 4)
        Noise-free voltages, V.
    """
    equations = record[0]
    rows = equations.output_rows
    # Transitions cost more than some sub-steps: they are the same in every period.
    before, after = _way(equations, delay_s), _way(equations, period_s - delay_s)
    outputs_v = np.empty((len(command_v) - 1, len(rows)))
    for sample in range(len(outputs_v)):
        _sample(state, rows, outputs_v[sample])
        _move(state, equations, command_v[sample], before)
        _move(state, equations, command_v[sample + 1], after)
    return outputs_v


@compiled
def advance(
    state: NDArray[np.float64], record: NDArray[np.void], command_v: float, interval_s: float
) -> None:
    """Move `state` on in place, by a constant command over an interval; arguments as for `run`."""
    equations = record[0]
    _move(state, equations, command_v, _way(equations, interval_s))


@compiled
def advance_all(  # noqa: PLR0917 - compiled code takes no keywords only
    states: NDArray[np.float64],
    records: NDArray[np.void],
    command_v: NDArray[np.float64],
    ways: NDArray[np.void],
    moving: NDArray[np.int64],
    outputs_v: NDArray[np.float64],
) -> None:
    """Move rigs of many on by a period and sample them, as `run` does with one.

    Parameters
    ----------
    states : ndarray, (rigs, 2, COLUMNS)
        Positions and velocities, changed in place.
    records : ndarray of RECORD, (rigs,)
        `Equations` of each.
    command_v : ndarray, (rigs, 2)
        Command in force, and the one that follows it within the period, V.
    ways : ndarray of WAY, (rigs, 2)
        Sub-steps of the period before the new command acts, and after.
    moving : ndarray of int
        Numbers of the rigs that move.
    outputs_v : ndarray, (rigs, 4)
        Takes their noise-free voltages at the end of the period, V.
    """
    for rig in moving:
        equations, state = records[rig], states[rig]
        for part in range(2):
            _move(state, equations, command_v[rig, part], ways[rig, part])
        _sample(state, equations.output_rows, outputs_v[rig])


@compiled
def _sample(
    state: NDArray[np.float64], rows: NDArray[np.float64], outputs_v: NDArray[np.float64]
) -> None:
    for channel in range(len(rows)):
        outputs_v[channel] = 0.0
        for column in range(COLUMNS):
            outputs_v[channel] += rows[channel, column] * state[POSITION, column]


@compiled
def way_of(record: NDArray[np.void], interval_s: float) -> Way:
    """Return the sub-steps of an interval; the record has shape (1,)."""
    return _way(record[0], interval_s)


@compiled
def _way(equations: Equations, interval_s: float) -> Way:
    # The margin of 0.1 ns keeps a rounding error in the interval from costing a sub-step.
    steps = math.ceil(interval_s * SUBSTEP_RATE_HZ - 1e-6)
    step_s = interval_s / max(steps, 1)
    return Way(
        steps, step_s, _transitions(equations, step_s / 2.0), _transitions(equations, step_s)
    )


class _Torques(NamedTuple):
    """What acts in a kick: numbers at hand, where a record's would be fetched in each of them.

    As in `Equations`, but for the torque of the drive, N m, the length of the kick, s, and damping
    by the change of depth in a kick.
    """

    drive_nm: float
    step_s: float
    motor_inertia: float
    coulomb_friction: float
    breakaway_excess: float
    stribeck_speed: float
    half_gap: float
    gear_stiffness: float
    gear_damping: float
    stop_angle: float
    stop_stiffness: float
    stop_damping: float
    arm_mobility: float


@compiled
def _torques(equations: Equations, command_v: float, step_s: float) -> _Torques:
    return _Torques(
        equations.motor_gain * min(max(command_v, -MAX_COMMAND_V), MAX_COMMAND_V),
        step_s,
        equations.motor_inertia,
        equations.coulomb_friction,
        equations.breakaway_excess,
        equations.stribeck_speed,
        equations.half_gap,
        equations.gear_stiffness,
        equations.gear_damping / step_s,
        equations.stop_angle,
        equations.stop_stiffness,
        equations.stop_damping / step_s,
        equations.arm_mobility,
    )


@compiled
def _move(state: NDArray[np.float64], equations: Equations, command_v: float, way: Way) -> None:
    if way.steps < 1:
        return
    torques = _torques(equations, command_v, way.step_s)
    hub_angle = equations.hub_angle
    # The half-steps between two kicks are taken as one.
    _drift(state, way.half, way.step_s / 2.0)
    for _ in range(way.steps - 1):
        _kick(state, hub_angle, torques)
        _drift(state, way.whole, way.step_s)
    _kick(state, hub_angle, torques)
    _drift(state, way.half, way.step_s / 2.0)
    _settle(state)


@compiled
def _transitions(equations: Equations, step_s: float) -> NDArray[np.float64]:
    """Return the exact transitions of x'' + d x' + k x = 0: entries 11, 12, 21, 22 by column."""
    transitions = np.empty((4, COLUMNS))
    for i in range(COLUMNS):
        stiffness, decay = equations.stiffness[i], equations.damping[i] / 2.0
        discriminant = stiffness - decay * decay
        root = math.sqrt(abs(discriminant))
        if discriminant > 0.0:
            cosine, sine = math.cos(root * step_s), math.sin(root * step_s) / root
        elif discriminant < 0.0:
            cosine, sine = math.cosh(root * step_s), math.sinh(root * step_s) / root
        else:
            cosine, sine = 1.0, step_s
        envelope = math.exp(-decay * step_s)
        transitions[0, i] = envelope * (cosine + decay * sine)
        transitions[1, i] = envelope * sine
        transitions[2, i] = -envelope * stiffness * sine
        transitions[3, i] = envelope * (cosine - decay * sine)
    return transitions


@compiled
def _drift(state: NDArray[np.float64], transitions: NDArray[np.float64], step_s: float) -> None:
    # The filter oscillates about the mean speed of its step, all other columns about zero.
    mean_speed = transitions[1, MOTOR] * state[VELOCITY, MOTOR] / step_s
    state[POSITION, TACHO] -= mean_speed
    for i in range(COLUMNS):
        position, velocity = state[POSITION, i], state[VELOCITY, i]
        state[POSITION, i] = transitions[0, i] * position + transitions[1, i] * velocity
        state[VELOCITY, i] = transitions[2, i] * position + transitions[3, i] * velocity
    state[POSITION, TACHO] += mean_speed


@compiled
def _kick(state: NDArray[np.float64], hub_angle: NDArray[np.float64], torques: _Torques) -> None:
    arm_angle = 0.0
    arm_speed = 0.0
    for i in range(MODES):
        arm_angle += hub_angle[i] * state[POSITION, ARM + i]
        arm_speed += hub_angle[i] * state[VELOCITY, ARM + i]
    state[VELOCITY, MOTOR], on_arm_nm = _meeting(
        state[POSITION, MOTOR], state[VELOCITY, MOTOR], arm_angle, arm_speed, torques
    )
    for i in range(MODES):
        state[VELOCITY, ARM + i] += torques.step_s * hub_angle[i] * on_arm_nm


@compiled
def _meeting(
    angle: float, speed: float, arm_angle: float, arm_speed: float, torques: _Torques
) -> tuple[float, float]:
    """Return the motor's speed after a kick, and the torque of teeth and stops on the arm."""
    step_s = torques.step_s
    twist = angle - arm_angle
    friction_speed = _friction_speed(speed, torques)
    new_speed, new_arm_speed = speed, arm_speed
    gear = stop = 0.0
    # Contact torques depend on the speeds that they cause. This fixed point takes two rounds.
    for _ in range(_ROUNDS):
        gear = _two_sided_contact(
            twist - (speed - arm_speed) * step_s / 2.0,
            twist + (new_speed - new_arm_speed) * step_s / 2.0,
            torques.half_gap,
            torques.gear_stiffness,
            torques.gear_damping,
        )
        stop = _two_sided_contact(
            arm_angle - arm_speed * step_s / 2.0,
            arm_angle + new_arm_speed * step_s / 2.0,
            torques.stop_angle,
            torques.stop_stiffness,
            torques.stop_damping,
        )
        free = speed + step_s * (torques.drive_nm - gear) / torques.motor_inertia
        new_speed = _slowed(free, friction_speed)
        new_arm_speed = arm_speed + step_s * torques.arm_mobility * (gear - stop)
        if gear == 0.0 and stop == 0.0:
            break
    return new_speed, gear - stop


@compiled
def _two_sided_contact(
    start: float, end: float, clearance: float, stiffness: float, damping_per_step: float
) -> float:
    """Return the mean torque between two angles of a contact on either side of a gap."""
    upper = _contact(start - clearance, end - clearance, stiffness, damping_per_step)
    return upper - _contact(-start - clearance, -end - clearance, stiffness, damping_per_step)


@compiled
def _contact(start: float, end: float, stiffness: float, damping_per_step: float) -> float:
    """Return the mean torque of a contact that pushes and never pulls, between two depths.

    Its work is exactly the change of the elastic energy, also when the contact begins or ends on
    the way.
    """
    if start <= 0.0 and end <= 0.0:
        return 0.0
    way = end - start
    if start > 0.0 and end > 0.0:
        mean_depth, touching = (start + end) / 2.0, 1.0
    else:
        # The depth is positive on one part of the way only.
        depth = max(start, end)
        touching = depth / abs(way)
        mean_depth = touching * depth / 2.0
    return max(0.0, stiffness * mean_depth + damping_per_step * touching * way)


@compiled
def _friction_speed(speed: float, torques: _Torques) -> float:
    """Return by how much dry friction changes the motor's speed in a kick, at most."""
    ratio = speed / torques.stribeck_speed
    friction_nm = torques.coulomb_friction
    # At higher speeds the excess is below rounding, and its exponential would cost the most time.
    if abs(ratio) < _STRIBECK_END:
        friction_nm *= 1.0 + torques.breakaway_excess * math.exp(-ratio * ratio)
    return torques.step_s * friction_nm / torques.motor_inertia


@compiled
def _slowed(free_speed: float, friction_speed: float) -> float:
    """Return a speed after dry friction, which reduces it, at most to zero."""
    if free_speed > friction_speed:
        return free_speed - friction_speed
    if free_speed < -friction_speed:
        return free_speed + friction_speed
    return 0.0


@compiled
def _settle(state: NDArray[np.float64]) -> None:
    for column in range(COLUMNS):
        if abs(state[VELOCITY, column]) < _REST:
            state[VELOCITY, column] = 0.0
            if abs(state[POSITION, column]) < _REST:
                state[POSITION, column] = 0.0

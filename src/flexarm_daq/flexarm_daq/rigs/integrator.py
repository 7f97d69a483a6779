"""Integrator of the rig's equations of motion, compiled.

An interval is made of sub-steps.

The functions write arrays in place and check nothing; `flexarm_daq.rigs.plant.Plant` calls them for
one rig. `flexarm_extras.batch.RigBatch` (in `extras`) moves many at once, each in a lane.

A sub-step of at most 0.1 ms is split in the manner of Strang. In each half-step the modes, the
tachometer filter and the viscous motor move by their exact transition matrices. The torques act as
a kick between the two halves. The method is of second order where the torques are smooth.

A contact acts with its mean torque over the sub-step. This is a discrete gradient: its work is the
change of its elastic energy. Teeth and stops that meet within a sub-step therefore give no energy,
and take energy only by their damping. Dry friction is a constraint on the kicked speed, so a motor
below break-away stands still and does not creep.

A block is one flat array: quantity by quantity, and of each the rigs' values (lanes). Every step
of the computation is a loop over the lanes without branches, which the compiler turns into vector
instructions. A rig's figures are the same to the bit in a block of any number of lanes. `lanes` is
a tuple of that length, as the length of a tuple is known when the code is compiled.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flexarm_core.channels import MAX_COMMAND_V
from flexarm_core.compilation import compiled
from flexarm_daq.rigs.equations import ARM, COLUMNS, MODES, MOTOR, POSITION, TACHO, VELOCITY, Way

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_daq.rigs.equations import Equations

    Block = NDArray[np.float64]
    Lanes = tuple[int, ...]

SUBSTEP_RATE_HZ = 10_000.0
"""Least rate of sub-steps: over 30 of them in the shortest period, that of the gear at 306 Hz."""
ONE: Final = (0,)
"""Lanes of a block for one rig."""

# First rows of the quantities with one row for each column of the state, or for each mode.
POSITIONS, VELOCITIES = 0, COLUMNS
HALF, WHOLE = 2 * COLUMNS, 6 * COLUMNS
HUB_ANGLES = 10 * COLUMNS
# Rows of the others: torque of the drive, time of a whole and of a half step, then as in
# `Equations`, but for damping by the change of depth in a step, and the present dry friction.
(
    DRIVE_NM,
    WHOLE_S,
    HALF_S,
    MOTOR_INERTIA,
    COULOMB_FRICTION,
    BREAKAWAY_EXCESS,
    STRIBECK_SPEED,
    HALF_GAP,
    GEAR_STIFFNESS,
    GEAR_DAMPING,
    STOP_ANGLE,
    STOP_STIFFNESS,
    STOP_DAMPING,
    ARM_MOBILITY,
    FRICTION_NM,
    ROWS,
) = range(HUB_ANGLES + MODES, HUB_ANGLES + MODES + 16)

# Amplitudes below this count as rest. Denormal numbers would slow the processor.
_REST = 1e-100

_STRIBECK_END = 6.5


@compiled
def move(block: Block, steps: int, lanes: Lanes) -> None:
    """Move the rigs of a block on by a number of sub-steps, at least one."""
    # The half-steps between two kicks are taken as one.
    _drift(block, HALF, HALF_S, lanes)
    for _ in range(steps - 1):
        _rub(block, lanes)
        _kick(block, lanes)
        _drift(block, WHOLE, WHOLE_S, lanes)
    _rub(block, lanes)
    _kick(block, lanes)
    _drift(block, HALF, HALF_S, lanes)
    _settle(block, lanes)


@compiled
def _drift(block: Block, transitions: int, step_s: int, lanes: Lanes) -> None:
    n = len(lanes)
    for lane in range(n):
        # The filter oscillates about the mean speed of its step, all other columns about zero.
        moved = (
            block[(transitions + COLUMNS + MOTOR) * n + lane]
            * block[(VELOCITIES + MOTOR) * n + lane]
        )
        mean_speed = moved / block[step_s * n + lane]
        block[(POSITIONS + TACHO) * n + lane] -= mean_speed
        for i in range(COLUMNS):
            position = block[(POSITIONS + i) * n + lane]
            velocity = block[(VELOCITIES + i) * n + lane]
            block[(POSITIONS + i) * n + lane] = (
                block[(transitions + i) * n + lane] * position
                + block[(transitions + COLUMNS + i) * n + lane] * velocity
            )
            block[(VELOCITIES + i) * n + lane] = (
                block[(transitions + 2 * COLUMNS + i) * n + lane] * position
                + block[(transitions + 3 * COLUMNS + i) * n + lane] * velocity
            )
        block[(POSITIONS + TACHO) * n + lane] += mean_speed


@compiled
def _rub(block: Block, lanes: Lanes) -> None:
    """Enter the dry friction at the present speed; apart, as the exponential is not a vector's."""
    n = len(lanes)
    for lane in range(n):
        ratio = block[(VELOCITIES + MOTOR) * n + lane] / block[STRIBECK_SPEED * n + lane]
        friction_nm = block[COULOMB_FRICTION * n + lane]
        # At higher speeds the excess is below rounding, and its exponential would cost most time.
        if abs(ratio) < _STRIBECK_END:
            friction_nm *= 1.0 + block[BREAKAWAY_EXCESS * n + lane] * math.exp(-ratio * ratio)
        block[FRICTION_NM * n + lane] = friction_nm


@compiled
def _kick(block: Block, lanes: Lanes) -> None:
    n = len(lanes)
    for lane in range(n):
        arm_angle = 0.0
        arm_speed = 0.0
        for i in range(MODES):
            hub_angle = block[(HUB_ANGLES + i) * n + lane]
            arm_angle += hub_angle * block[(POSITIONS + ARM + i) * n + lane]
            arm_speed += hub_angle * block[(VELOCITIES + ARM + i) * n + lane]
        step_s = block[WHOLE_S * n + lane]
        speed = block[(VELOCITIES + MOTOR) * n + lane]
        inertia, drive_nm = block[MOTOR_INERTIA * n + lane], block[DRIVE_NM * n + lane]
        mobility = block[ARM_MOBILITY * n + lane]
        friction_speed = step_s * block[FRICTION_NM * n + lane] / inertia
        half_gap, stop_angle = block[HALF_GAP * n + lane], block[STOP_ANGLE * n + lane]
        gear_stiffness = block[GEAR_STIFFNESS * n + lane]
        gear_damping = block[GEAR_DAMPING * n + lane]
        stop_stiffness = block[STOP_STIFFNESS * n + lane]
        stop_damping = block[STOP_DAMPING * n + lane]
        twist = block[(POSITIONS + MOTOR) * n + lane] - arm_angle
        twist_start = twist - (speed - arm_speed) * step_s / 2.0
        arm_start = arm_angle - arm_speed * step_s / 2.0

        # Contact torques depend on the speeds that they cause. This fixed point takes two rounds.
        twist_end = twist + (speed - arm_speed) * step_s / 2.0
        gear_nm = _two_sided(twist_start, twist_end, half_gap, gear_stiffness, gear_damping)
        arm_end = arm_angle + arm_speed * step_s / 2.0
        stop_nm = _two_sided(arm_start, arm_end, stop_angle, stop_stiffness, stop_damping)
        free_speed = _slowed(speed + step_s * (drive_nm - gear_nm) / inertia, friction_speed)
        new_arm_speed = arm_speed + step_s * mobility * (gear_nm - stop_nm)
        apart = (gear_nm == 0.0) & (stop_nm == 0.0)

        twist_end = twist + (free_speed - new_arm_speed) * step_s / 2.0
        gear_nm = _two_sided(twist_start, twist_end, half_gap, gear_stiffness, gear_damping)
        arm_end = arm_angle + new_arm_speed * step_s / 2.0
        stop_nm = _two_sided(arm_start, arm_end, stop_angle, stop_stiffness, stop_damping)
        met_speed = _slowed(speed + step_s * (drive_nm - gear_nm) / inertia, friction_speed)

        block[(VELOCITIES + MOTOR) * n + lane] = free_speed if apart else met_speed
        on_arm_nm = 0.0 if apart else gear_nm - stop_nm
        for i in range(MODES):
            block[(VELOCITIES + ARM + i) * n + lane] += (
                step_s * block[(HUB_ANGLES + i) * n + lane] * on_arm_nm
            )


@compiled
def _two_sided(
    start: float, end: float, clearance: float, stiffness: float, damping_per_step: float
) -> float:
    """Return the mean torque between two angles of a contact on either side of a gap."""
    upper = _contact(start - clearance, end - clearance, stiffness, damping_per_step)
    return upper - _contact(-start - clearance, -end - clearance, stiffness, damping_per_step)


@compiled
def _contact(start: float, end: float, stiffness: float, damping_per_step: float) -> float:
    """Return the mean torque of a contact that pushes and never pulls, between two depths.

    Its work is exactly the change of the elastic energy, also when the contact begins or ends on
    the way: the depth is then positive on one part of the way only.
    """
    way = end - start
    deepest = max(start, end)
    throughout = (start > 0.0) & (end > 0.0)
    touching = 1.0 if throughout else deepest / (abs(way) if way != 0.0 else 1.0)
    mean_depth = (start + end) / 2.0 if throughout else touching * deepest / 2.0
    torque_nm = stiffness * mean_depth + damping_per_step * touching * way
    return torque_nm if (deepest > 0.0) & (torque_nm > 0.0) else 0.0


@compiled
def _slowed(free_speed: float, friction_speed: float) -> float:
    """Return a speed after dry friction, which reduces it, at most to zero."""
    back_speed = free_speed + friction_speed if free_speed < -friction_speed else 0.0
    return free_speed - friction_speed if free_speed > friction_speed else back_speed


@compiled
def _settle(block: Block, lanes: Lanes) -> None:
    n = len(lanes)
    for position in range(COLUMNS * n):
        velocity = VELOCITIES * n + position
        if abs(block[velocity]) < _REST:
            block[velocity] = 0.0
            if abs(block[position]) < _REST:
                block[position] = 0.0


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
    before, after = way_of(equations, delay_s), way_of(equations, period_s - delay_s)
    outputs_v = np.empty((len(command_v) - 1, len(rows)))
    block = np.empty(ROWS)
    take_rig(block, 0, equations, ONE)
    take_state(block, 0, state, ONE)
    for sample in range(len(outputs_v)):
        read_out(state, rows, outputs_v[sample])
        _move_one(block, equations, command_v[sample], before)
        _move_one(block, equations, command_v[sample + 1], after)
        give_state(block, 0, state, ONE)
    return outputs_v


@compiled
def advance(
    state: NDArray[np.float64], record: NDArray[np.void], command_v: float, interval_s: float
) -> None:
    """Move `state` on in place, by a constant command over an interval; arguments as for `run`."""
    equations = record[0]
    block = np.empty(ROWS)
    take_rig(block, 0, equations, ONE)
    take_state(block, 0, state, ONE)
    _move_one(block, equations, command_v, way_of(equations, interval_s))
    give_state(block, 0, state, ONE)


@compiled
def read_out(
    state: NDArray[np.float64], rows: NDArray[np.float64], outputs_v: NDArray[np.float64]
) -> None:
    """Take the noise-free voltages of a state, V."""
    for channel in range(len(rows)):
        outputs_v[channel] = 0.0
        for column in range(COLUMNS):
            outputs_v[channel] += rows[channel, column] * state[POSITION, column]


@compiled
def way_of(equations: Equations, interval_s: float) -> Way:
    """Return the sub-steps of an interval."""
    # The margin of 0.1 ns keeps a rounding error in the interval from costing a sub-step.
    steps = math.ceil(interval_s * SUBSTEP_RATE_HZ - 1e-6)
    step_s = interval_s / max(steps, 1)
    return Way(
        steps, step_s, _transitions(equations, step_s / 2.0), _transitions(equations, step_s)
    )


@compiled
def _move_one(block: Block, equations: Equations, command_v: float, way: Way) -> None:
    if way.steps > 0:
        take_way(block, 0, equations, command_v, way, ONE)
        move(block, way.steps, ONE)


@compiled
def take_rig(block: Block, lane: int, equations: Equations, lanes: Lanes) -> None:
    """Put the equations of a rig into a lane of a block."""
    n = len(lanes)
    block[MOTOR_INERTIA * n + lane] = equations.motor_inertia
    block[COULOMB_FRICTION * n + lane] = equations.coulomb_friction
    block[BREAKAWAY_EXCESS * n + lane] = equations.breakaway_excess
    block[STRIBECK_SPEED * n + lane] = equations.stribeck_speed
    block[HALF_GAP * n + lane] = equations.half_gap
    block[GEAR_STIFFNESS * n + lane] = equations.gear_stiffness
    block[STOP_ANGLE * n + lane] = equations.stop_angle
    block[STOP_STIFFNESS * n + lane] = equations.stop_stiffness
    block[ARM_MOBILITY * n + lane] = equations.arm_mobility
    for i in range(MODES):
        block[(HUB_ANGLES + i) * n + lane] = equations.hub_angle[i]


@compiled
def take_way(  # noqa: PLR0917 - compiled code takes no keywords only
    block: Block, lane: int, equations: Equations, command_v: float, way: Way, lanes: Lanes
) -> None:
    """Put the sub-steps of an interval, and the command in it, into a lane."""
    n = len(lanes)
    for entry in range(4):
        for i in range(COLUMNS):
            row = entry * COLUMNS + i
            block[(HALF + row) * n + lane] = way.half[entry, i]
            block[(WHOLE + row) * n + lane] = way.whole[entry, i]
    clipped_v = min(max(command_v, -MAX_COMMAND_V), MAX_COMMAND_V)
    torque_nm = equations.motor_gain * clipped_v
    block[DRIVE_NM * n + lane] = min(
        max(torque_nm, -equations.largest_torque), equations.largest_torque
    )
    block[WHOLE_S * n + lane] = way.step_s
    block[HALF_S * n + lane] = way.step_s / 2.0
    block[GEAR_DAMPING * n + lane] = equations.gear_damping / way.step_s
    block[STOP_DAMPING * n + lane] = equations.stop_damping / way.step_s


@compiled
def take_state(block: Block, lane: int, state: NDArray[np.float64], lanes: Lanes) -> None:
    """Put a state into a lane."""
    n = len(lanes)
    for i in range(COLUMNS):
        block[(POSITIONS + i) * n + lane] = state[POSITION, i]
        block[(VELOCITIES + i) * n + lane] = state[VELOCITY, i]


@compiled
def give_state(block: Block, lane: int, state: NDArray[np.float64], lanes: Lanes) -> None:
    """Take a state out of a lane."""
    n = len(lanes)
    for i in range(COLUMNS):
        state[POSITION, i] = block[(POSITIONS + i) * n + lane]
        state[VELOCITY, i] = block[(VELOCITIES + i) * n + lane]


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

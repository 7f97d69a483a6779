"""Sub-step of the rig's motion, on a block of rigs side by side, compiled.

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

from flexarm_core.compilation import compiled
from flexarm_daq.rigs.equations import ARM, COLUMNS, MODES, MOTOR, TACHO

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Block = NDArray[np.float64]
    Lanes = tuple[int, ...]

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

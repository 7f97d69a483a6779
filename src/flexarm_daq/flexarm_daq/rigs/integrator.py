"""Integrator of the rig's equations of motion, compiled.

`flexarm_daq.rigs.substep` has the sub-steps that an interval is made of.

The functions write arrays in place and check nothing; `flexarm_daq.rigs.plant.Plant` calls them for
one rig. `flexarm_extras.batch.RigBatch` (in `extras`) moves many at once, each in a lane.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.channels import MAX_COMMAND_V
from flexarm_core.compilation import compiled
from flexarm_daq.rigs import substep
from flexarm_daq.rigs.equations import COLUMNS, MODES, POSITION, VELOCITY, Way
from flexarm_daq.rigs.substep import ONE, ROWS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_daq.rigs.equations import Equations
    from flexarm_daq.rigs.substep import Block, Lanes

SUBSTEP_RATE_HZ = 10_000.0
"""Least rate of sub-steps: over 30 of them in the shortest period, that of the gear at 306 Hz."""


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
        substep.move(block, way.steps, ONE)


@compiled
def take_rig(block: Block, lane: int, equations: Equations, lanes: Lanes) -> None:
    """Put the equations of a rig into a lane of a block."""
    n = len(lanes)
    block[substep.MOTOR_INERTIA * n + lane] = equations.motor_inertia
    block[substep.COULOMB_FRICTION * n + lane] = equations.coulomb_friction
    block[substep.BREAKAWAY_EXCESS * n + lane] = equations.breakaway_excess
    block[substep.STRIBECK_SPEED * n + lane] = equations.stribeck_speed
    block[substep.HALF_GAP * n + lane] = equations.half_gap
    block[substep.GEAR_STIFFNESS * n + lane] = equations.gear_stiffness
    block[substep.STOP_ANGLE * n + lane] = equations.stop_angle
    block[substep.STOP_STIFFNESS * n + lane] = equations.stop_stiffness
    block[substep.ARM_MOBILITY * n + lane] = equations.arm_mobility
    for i in range(MODES):
        block[(substep.HUB_ANGLES + i) * n + lane] = equations.hub_angle[i]


@compiled
def take_way(  # noqa: PLR0917 - compiled code takes no keywords only
    block: Block, lane: int, equations: Equations, command_v: float, way: Way, lanes: Lanes
) -> None:
    """Put the sub-steps of an interval, and the command in it, into a lane."""
    n = len(lanes)
    for entry in range(4):
        for i in range(COLUMNS):
            row = entry * COLUMNS + i
            block[(substep.HALF + row) * n + lane] = way.half[entry, i]
            block[(substep.WHOLE + row) * n + lane] = way.whole[entry, i]
    clipped_v = min(max(command_v, -MAX_COMMAND_V), MAX_COMMAND_V)
    torque_nm = equations.motor_gain * clipped_v
    block[substep.DRIVE_NM * n + lane] = min(
        max(torque_nm, -equations.largest_torque), equations.largest_torque
    )
    block[substep.WHOLE_S * n + lane] = way.step_s
    block[substep.HALF_S * n + lane] = way.step_s / 2.0
    block[substep.GEAR_DAMPING * n + lane] = equations.gear_damping / way.step_s
    block[substep.STOP_DAMPING * n + lane] = equations.stop_damping / way.step_s


@compiled
def take_state(block: Block, lane: int, state: NDArray[np.float64], lanes: Lanes) -> None:
    """Put a state into a lane."""
    n = len(lanes)
    for i in range(COLUMNS):
        block[(substep.POSITIONS + i) * n + lane] = state[POSITION, i]
        block[(substep.VELOCITIES + i) * n + lane] = state[VELOCITY, i]


@compiled
def give_state(block: Block, lane: int, state: NDArray[np.float64], lanes: Lanes) -> None:
    """Take a state out of a lane."""
    n = len(lanes)
    for i in range(COLUMNS):
        state[POSITION, i] = block[(substep.POSITIONS + i) * n + lane]
        state[VELOCITY, i] = block[(substep.VELOCITIES + i) * n + lane]


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

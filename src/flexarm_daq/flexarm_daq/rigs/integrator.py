"""Integrator of the rig's equations of motion, compiled: intervals, and many rigs at once.

`flexarm_daq.rigs.substep` has the sub-steps that an interval is made of.

The functions write arrays in place and check nothing; `flexarm_daq.rigs.plant.Plant` calls them for
one rig, `flexarm_extras.batch.RigBatch` (in `extras`) for many.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.channels import MAX_COMMAND_V
from flexarm_core.compilation import compiled
from flexarm_daq.rigs import substep
from flexarm_daq.rigs.equations import COLUMNS, MODES, POSITION, VELOCITY, Way
from flexarm_daq.rigs.substep import MANY, ONE, ROWS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_daq.rigs.equations import Equations
    from flexarm_daq.rigs.substep import Block, Lanes

SUBSTEP_RATE_HZ = 10_000.0
"""Least rate of sub-steps: over 30 of them in the shortest period, that of the gear at 306 Hz."""
# A block of fewer rigs takes longer than each of them alone.
_WORTH = 3


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
    block = np.empty(ROWS)
    _take_rig(block, 0, equations, ONE)
    _take_state(block, 0, state, ONE)
    for sample in range(len(outputs_v)):
        _sample(state, rows, outputs_v[sample])
        _move_one(block, equations, command_v[sample], before)
        _move_one(block, equations, command_v[sample + 1], after)
        _give_state(block, 0, state, ONE)
    return outputs_v


@compiled
def advance(
    state: NDArray[np.float64], record: NDArray[np.void], command_v: float, interval_s: float
) -> None:
    """Move `state` on in place, by a constant command over an interval; arguments as for `run`."""
    equations = record[0]
    block = np.empty(ROWS)
    _take_rig(block, 0, equations, ONE)
    _take_state(block, 0, state, ONE)
    _move_one(block, equations, command_v, _way(equations, interval_s))
    _give_state(block, 0, state, ONE)


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
        Numbers of the rigs that move. Neighbours with equal numbers of sub-steps move together.
    outputs_v : ndarray, (rigs, 4)
        Takes their noise-free voltages at the end of the period, V.
    """
    one, many = np.empty(ROWS), np.empty(ROWS * len(MANY))
    done = 0
    while done < len(moving):
        rigs = _alike(moving[done : done + len(MANY)], ways)
        done += len(rigs)
        if len(rigs) < _WORTH:
            for i in range(len(rigs)):
                _advance_block(one, states, records, command_v, ways, rigs[i : i + 1], ONE)
        else:
            _advance_block(many, states, records, command_v, ways, rigs, MANY)
        for rig in rigs:
            _sample(states[rig], records[rig].output_rows, outputs_v[rig])


@compiled
def _advance_block(  # noqa: PLR0917 - compiled code takes no keywords only
    block: Block,
    states: NDArray[np.float64],
    records: NDArray[np.void],
    command_v: NDArray[np.float64],
    ways: NDArray[np.void],
    rigs: NDArray[np.int64],
    lanes: Lanes,
) -> None:
    """Move at most as many rigs as there are lanes, with equal numbers of sub-steps."""
    for lane in range(len(lanes)):
        # Lanes without a rig of their own compute the last one's again, unused.
        rig = rigs[min(lane, len(rigs) - 1)]
        _take_rig(block, lane, records[rig], lanes)
        _take_state(block, lane, states[rig], lanes)
    for part in range(2):
        steps = ways[rigs[0], part].steps
        if steps < 1:
            continue
        for lane in range(len(lanes)):
            rig = rigs[min(lane, len(rigs) - 1)]
            _take_way(block, lane, records[rig], command_v[rig, part], ways[rig, part], lanes)
        substep.move(block, steps, lanes)
    for lane in range(len(rigs)):
        _give_state(block, lane, states[rigs[lane]], lanes)


@compiled
def _alike(rigs: NDArray[np.int64], ways: NDArray[np.void]) -> NDArray[np.int64]:
    """Return the first rigs, up to one whose period has other numbers of sub-steps."""
    first = ways[rigs[0]]
    count = 1
    while count < len(rigs):
        other = ways[rigs[count]]
        if other[0].steps != first[0].steps or other[1].steps != first[1].steps:
            break
        count += 1
    return rigs[:count]


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


@compiled
def _move_one(block: Block, equations: Equations, command_v: float, way: Way) -> None:
    if way.steps > 0:
        _take_way(block, 0, equations, command_v, way, ONE)
        substep.move(block, way.steps, ONE)


@compiled
def _take_rig(block: Block, lane: int, equations: Equations, lanes: Lanes) -> None:
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
def _take_way(  # noqa: PLR0917 - compiled code takes no keywords only
    block: Block, lane: int, equations: Equations, command_v: float, way: Way, lanes: Lanes
) -> None:
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
def _take_state(block: Block, lane: int, state: NDArray[np.float64], lanes: Lanes) -> None:
    n = len(lanes)
    for i in range(COLUMNS):
        block[(substep.POSITIONS + i) * n + lane] = state[POSITION, i]
        block[(substep.VELOCITIES + i) * n + lane] = state[VELOCITY, i]


@compiled
def _give_state(block: Block, lane: int, state: NDArray[np.float64], lanes: Lanes) -> None:
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

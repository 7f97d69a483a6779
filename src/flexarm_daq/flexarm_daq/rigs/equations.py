"""Coefficients of the rig's equations of motion, and the layout of its state and transitions."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.channels import CHANNELS
from flexarm_daq.rigs.beam import FLEXIBLE_MODES

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Rows of the state, and its columns: the motor, the tachometer filter, then the arm's modes.
POSITION, VELOCITY = 0, 1
MOTOR, TACHO, ARM = 0, 1, 2
MODES = 1 + FLEXIBLE_MODES
COLUMNS = ARM + MODES


class Equations(NamedTuple):
    """Coefficients of the equations of motion, in SI units; a row of `RECORD` to compiled code.

    The excess of friction is relative to sliding friction. The arm's mobility is the sum of the
    squared hub angles, the acceleration of its hub by a unit of torque. Stiffness and damping are
    per unit of mass, one entry per column of the state; output rows turn positions into volts.
    """

    motor_inertia: float
    motor_gain: float
    largest_torque: float
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
    hub_angle: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    damping: NDArray[np.float64]
    output_rows: NDArray[np.float64]


_SHAPES = {
    "hub_angle": (MODES,),
    "stiffness": (COLUMNS,),
    "damping": (COLUMNS,),
    "output_rows": (len(CHANNELS), COLUMNS),
}
# A dtype of np.record: rows give their fields as attributes without compiling, too.
RECORD = np.dtype(
    (np.record, [(name, np.float64, _SHAPES.get(name, ())) for name in Equations._fields])
)


class Way(NamedTuple):
    """Sub-steps of an interval: how many, how long, the transitions of half and of whole ones."""

    steps: int
    step_s: float
    half: NDArray[np.float64]
    whole: NDArray[np.float64]

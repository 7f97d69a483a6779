"""Rest-to-rest moves of the flat model, smooth enough that the command begins and ends at zero.

The model is flat [1]_: command and outputs are sums of derivatives of one signal z, which at rest
is the position. A move of z between two points of rest, smooth enough, is one of the whole arm::

    u  = (z'''' + (2 zeta w + d) z''' + (w^2 + 2 zeta w d) z'' + w^2 d z') / (g w^2)
    y1 = z + ((2 zeta w + rho d) z' + (1 + rho) z'') / w^2
    y3 = mu (z'' + d z'),    y4 = tau y1'

It lasts longer than a move of `flexarm_control.planning`, and has nothing above the frequencies
that a repetition learns.

References
----------
.. [1] Fliess, M., Levine, J., Martin, P., and Rouchon, P. (1995). Flatness and defect of non-linear
   systems: introductory theory and examples. International Journal of Control 61(6), 1327-1361.
"""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyval

from flexarm_control.planning.flat_arm import SPEED_PER_POSITION_S

if TYPE_CHECKING:
    from flexarm_control.planning.flat_arm import FlatArm
    from flexarm_core.arrays import FloatArray

_ORDER = 4
"""Derivatives of z that vanish at both ends: the order of the model."""


def progress(share: FloatArray) -> FloatArray:
    """Return a move of one from 0 to 1 and its derivatives up to the fourth, (5, points).

    All four derivatives vanish at both ends. The move is the integral of a multiple of x^4 (1-x)^4.
    """
    return np.asarray(polyval(share, _PROGRESS), dtype=np.float64)


def _progress() -> FloatArray:
    """Return the coefficients of the move and its derivatives, one column each."""
    x = Polynomial([0.0, 1.0])
    rise = (x**_ORDER * (1.0 - x) ** _ORDER).integ()
    columns = [(rise / rise(1.0)).deriv(order).coef for order in range(_ORDER + 1)]
    return np.column_stack([np.pad(each, (0, len(rise.coef) - len(each))) for each in columns])


_PROGRESS: FloatArray = _progress()


def command_weights(arm: FlatArm) -> FloatArray:
    """Return the weights of z', z'', z''' and z'''' in the command, (4,)."""
    w, drag = 2.0 * pi * arm.frequency_hz, arm.drag_per_s
    decay = 2.0 * arm.damping_ratio * w
    weights = np.array([w**2 * drag, w**2 + decay * drag, decay + drag, 1.0])
    return weights / (arm.gain_per_s2 * w**2)


def output_weights(arm: FlatArm) -> FloatArray:
    """Return the weights of z to z''' in position, middle gauge and speed, (3, 4)."""
    w = 2.0 * pi * arm.frequency_hz
    first = (2.0 * arm.damping_ratio * w + arm.hub_share * arm.drag_per_s) / w**2
    second = (1.0 + arm.hub_share) / w**2
    bend, tau = arm.middle_strain_s2, SPEED_PER_POSITION_S
    return np.array(
        [
            [1.0, first, second, 0.0],
            [0.0, bend * arm.drag_per_s, bend, 0.0],
            [0.0, tau, tau * first, tau * second],
        ]
    )


def unit_move(arm: FlatArm, samples: int, rate_hz: float) -> FloatArray:
    """Return position, middle gauge, speed and command of a move of 1 V, (4, samples).

    A command is held over its period, so it is that of the middle of the period.

    Parameters
    ----------
    arm : FlatArm
        Arm.
    samples : int
        Length of the move.
    rate_hz : float
        Sampling rate, Hz.
    """
    at = np.arange(samples) / samples
    scale = (samples / rate_hz) ** -np.arange(_ORDER + 1.0)[:, None]
    outputs = output_weights(arm) @ (scale * progress(at))[:_ORDER]
    held = scale * progress(at + 0.5 / samples)
    return np.vstack([outputs, command_weights(arm) @ held[1:]])

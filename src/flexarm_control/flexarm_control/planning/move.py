"""Rest-to-rest moves of the flat model, smooth enough that the command begins and ends at zero."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyval

from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    from flexarm_control.planning.flat_arm import FlatArm
    from flexarm_core.arrays import FloatArray

LONGEST_S = 10.0
"""Longest move; with figures far from those of an arm it may need more than the wanted command."""

_ORDER = 4
"""Derivatives of z that vanish at both ends: the order of the model."""


class Planned(NamedTuple):
    """Plan at one sample.

    Attributes
    ----------
    command_v : float
        Command from this sample to the next one, V.
    left_v : float
        Position less the end of the move, V.
    middle_strain_v, speed_v : float
        Signals of the middle gauge and the tachometer, V.
    next_speed_v : float
        Tachometer signal at the next sample, V.
    """

    command_v: float
    left_v: float
    middle_strain_v: float
    speed_v: float
    next_speed_v: float


Move: TypeAlias = tuple[Planned, ...]
"""Plan of a move, sample by sample; it is over after the last."""


@dataclass(frozen=True)
class MoveSettings(Bounded):
    """Peak, least duration and first payload of the plans, and speed of the full compensation."""

    peak_v: float = setting(6.0, 0.2, 9.0, "V", "largest command of a plan, without compensation")
    shortest_s: float = setting(0.25, 0.05, 5.0, "s", "shortest duration of a plan")
    payload_kg: float = setting(0.0, 0.0, 1.0, "kg", "payload of the plans until one is detected")
    full_speed_v: float = setting(0.06, 0.001, 5.0, "V", "planned speed of the full compensation")


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
_RATES: FloatArray = progress(np.linspace(0.0, 1.0, 65))[1:]


def shortest_samples(arm: FlatArm, height_v: float, settings: MoveSettings, rate_hz: float) -> int:
    """Return the fewest samples of a move whose command stays within the peak.

    Parameters
    ----------
    arm : FlatArm
        Arm.
    height_v : float
        Distance, V.
    settings : MoveSettings
        Peak and least duration; the duration is at most `LONGEST_S`.
    rate_hz : float
        Sampling rate, Hz.
    """
    rates = arm.command_weights()[:, None] * _RATES * abs(height_v)
    orders = np.arange(1, _ORDER + 1)

    def is_within(samples: int) -> bool:
        command_v = (samples / rate_hz) ** -orders @ rates
        return bool(np.abs(command_v).max() <= settings.peak_v)

    least, most = ceil(settings.shortest_s * rate_hz), ceil(LONGEST_S * rate_hz)
    return bisect_left(range(most), x=True, lo=least, key=is_within)


def plan(arm: FlatArm, height_v: float, samples: int, rate_hz: float) -> Move:
    """Plan a move over a number of samples.

    A command is held over its period, so it is that of the middle of the period.
    """
    at = np.arange(samples + 1) / samples
    scale = height_v * (samples / rate_hz) ** -np.arange(_ORDER + 1.0)[:, None]
    outputs = arm.output_weights() @ (scale * progress(at))[:_ORDER]
    held = scale * progress(at[:-1] + 0.5 / samples)
    command_v = arm.command_weights() @ held[1:]
    position_v, strain_v, speed_v = outputs
    columns = (command_v, position_v[:-1] - height_v, strain_v[:-1], speed_v[:-1], speed_v[1:])
    return tuple(Planned(*row) for row in np.column_stack(columns).tolist())

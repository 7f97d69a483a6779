"""Reference shapers: parts of a change of the reference that leave one vibration at rest.

A shaper replaces each change of the reference by a few parts of it, which begin at different
instants. The vibrations that the parts excite cancel [1]_ [2]_ [3]_. The parts stand on samples. A
part between two samples is split between them, so that its effect on the vibration stays exact.

References
----------
.. [1] Singer, N. C., and Seering, W. P. (1990). Preshaping command inputs to reduce system
   vibration. ASME Journal of Dynamic Systems, Measurement, and Control 112(1), 76-82.
.. [2] Singhose, W., Seering, W., and Singer, N. (1994). Residual vibration reduction using vector
   diagrams to generate shaped inputs. ASME Journal of Mechanical Design 116(2), 654-659.
.. [3] Flash, T., and Hogan, N. (1985). The coordination of arm movements: an experimentally
   confirmed mathematical model. Journal of Neuroscience 5(7), 1688-1703.
"""

from __future__ import annotations

from math import ceil, exp, floor, pi, sqrt
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flexarm_core.arrays import FloatArray

NONE = "none"
"""The reference is not shaped."""
EI_VIBRATION = 0.05
"""Residual vibration that `ei` allows at the frequency itself."""
LONGEST_PERIODS = 1.84
"""Periods of the vibration after which every shaper is over."""
# The spectrum of the speed of minimum jerk is j2(s) / s^2, s = w T / 2, with its first zero here.
_MINIMUM_JERK_ZERO = 5.763459196894550
_ROUNDING = 1e-9


class Vibration(NamedTuple):
    """Mode of a vibration.

    Attributes
    ----------
    frequency_hz : float
        Natural frequency, Hz.
    damping_ratio : float
        Damping ratio, below 1.
    """

    frequency_hz: float
    damping_ratio: float

    @property
    def decay_per_s(self) -> float:
        """Rate at which the amplitude decays, 1/s."""
        return 2.0 * pi * self.frequency_hz * self.damping_ratio

    @property
    def damped_hz(self) -> float:
        """Frequency of the free vibration, Hz."""
        return self.frequency_hz * sqrt(1.0 - self.damping_ratio**2)


def shaper_parts(name: str, vibration: Vibration, dt_s: float) -> FloatArray:
    """Return the parts of a change of the reference at its own sample and the next ones.

    Parameters
    ----------
    name : str
        Key of `SHAPERS`.
    vibration : Vibration
        Mode that stays at rest.
    dt_s : float
        Sampling period, s.

    Returns
    -------
    ndarray, (samples,)
        Parts, none negative; their sum is 1.
    """
    parts = SHAPERS[name](vibration, dt_s)
    shared: FloatArray = parts / parts.sum()
    return shared


def _zv(vibration: Vibration, dt_s: float) -> FloatArray:
    """Return two parts half a period apart: zero vibration."""
    return _at_half_periods((1.0, 1.0), vibration, dt_s)


def _zvd(vibration: Vibration, dt_s: float) -> FloatArray:
    """Return three parts: zero vibration, and zero derivative of it by the frequency."""
    return _at_half_periods((1.0, 2.0, 1.0), vibration, dt_s)


def _ei(vibration: Vibration, dt_s: float) -> FloatArray:
    """Return three parts that allow some vibration, and are extra-insensitive to the frequency."""
    outer, inner = 1.0 + EI_VIBRATION, 2.0 - 2.0 * EI_VIBRATION
    return _at_half_periods((outer, inner, outer), vibration, dt_s)


def _jerk(vibration: Vibration, dt_s: float) -> FloatArray:
    """Return the curve of minimum jerk whose spectrum has its first zero at the frequency."""
    length_s = _MINIMUM_JERK_ZERO / (pi * vibration.frequency_hz)
    progress = np.minimum(np.arange(ceil(length_s / dt_s) + 1) * dt_s / length_s, 1.0)
    return np.diff(progress**3 * (10.0 - 15.0 * progress + 6.0 * progress**2))


def _at_half_periods(shares: tuple[float, ...], vibration: Vibration, dt_s: float) -> FloatArray:
    """Return parts half a period apart, each reduced as the vibration has decayed by then."""
    half_period_s = 0.5 / vibration.damped_hz
    parts = np.zeros(floor((len(shares) - 1) * half_period_s / dt_s + _ROUNDING) + 2)
    # A part later by one sample counts so much more and is turned so far.
    later = np.exp(complex(vibration.decay_per_s, -2.0 * pi * vibration.damped_hz) * dt_s)
    for number, share in enumerate(shares):
        instant_s = number * half_period_s
        at = floor(instant_s / dt_s + _ROUNDING)
        wanted = share * exp(-vibration.decay_per_s * instant_s) * later ** (instant_s / dt_s - at)
        second = wanted.imag / later.imag
        parts[at] += wanted.real - second * later.real
        parts[at + 1] += second
    return parts


#: Every shaper by the name it has as a ROS parameter.
SHAPERS: Mapping[str, Callable[[Vibration, float], FloatArray]] = MappingProxyType(
    {"zv": _zv, "zvd": _zvd, "ei": _ei, "jerk": _jerk}
)

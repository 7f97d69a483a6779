"""Reference shapers: parts of a change of the reference that leave one vibration at rest.

A shaper replaces each change of the reference by a few parts of it, which begin at different
instants. The vibrations that the parts excite cancel [1]_ [2]_ [3]_ [4]_. The parts stand on
samples. A part between two samples is split between them, so that its effect on the vibration stays
exact.

References
----------
.. [1] Singer, N. C., and Seering, W. P. (1990). Preshaping command inputs to reduce system
   vibration. ASME Journal of Dynamic Systems, Measurement, and Control 112(1), 76-82.
.. [2] Singhose, W., Seering, W., and Singer, N. (1994). Residual vibration reduction using vector
   diagrams to generate shaped inputs. ASME Journal of Mechanical Design 116(2), 654-659.
.. [3] Singhose, W., Porter, L., Tuttle, T., and Singer, N. (1997). Vibration reduction using
   multi-hump input shapers. ASME Journal of Dynamic Systems, Measurement, and Control 119(2),
   320-326.
.. [4] Flash, T., and Hogan, N. (1985). The coordination of arm movements: an experimentally
   confirmed mathematical model. Journal of Neuroscience 5(7), 1688-1703.
"""

from __future__ import annotations

from functools import partial
from math import ceil, floor, pi, sqrt
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flexarm_core.arrays import FloatArray

NONE = "none"
"""The reference is not shaped."""
EI_VIBRATION = 0.05
"""Residual vibration that `ei` and those with more humps allow at the frequency itself."""
LONGEST_PERIODS = 2.5
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


class Impulses(NamedTuple):
    """Parts of a change, which sum up to 1, and the instants of each, s, both (parts,)."""

    parts: FloatArray
    instants_s: FloatArray


def impulses(name: str, vibration: Vibration) -> Impulses:
    """Return the parts of a shaper before they are put on samples; `name` is one of `PARTED`.

    Each is reduced as the vibration has decayed by then.
    """
    shares, apart = PARTED[name]
    instants_s = np.asarray(np.arange(len(shares)) * apart / vibration.damped_hz, dtype=np.float64)
    parts = np.asarray(shares * np.exp(-vibration.decay_per_s * instants_s), dtype=np.float64)
    return Impulses(np.asarray(parts / parts.sum()), instants_s)


def _two_humps() -> tuple[float, ...]:
    """Return four parts between whose two humps the vibration is zero."""
    allowed = EI_VIBRATION**2
    root = (allowed * (sqrt(1.0 - allowed) + 1.0)) ** (1.0 / 3.0)
    outer = (3.0 * root**2 + 2.0 * root + 3.0 * allowed) / (16.0 * root)
    return outer, 0.5 - outer, 0.5 - outer, outer


def _three_humps() -> tuple[float, ...]:
    """Return five parts, likewise with three humps."""
    outer = (1.0 + 3.0 * EI_VIBRATION + sqrt(8.0 * EI_VIBRATION * (EI_VIBRATION + 1.0))) / 16.0
    inner = 0.25 * (1.0 - EI_VIBRATION)
    return outer, inner, 1.0 - 2.0 * (outer + inner), inner, outer


def _jerk(vibration: Vibration, dt_s: float) -> FloatArray:
    """Return the curve of minimum jerk whose spectrum has its first zero at the frequency."""
    length_s = _MINIMUM_JERK_ZERO / (pi * vibration.frequency_hz)
    progress = np.minimum(np.arange(ceil(length_s / dt_s) + 1) * dt_s / length_s, 1.0)
    return np.diff(progress**3 * (10.0 - 15.0 * progress + 6.0 * progress**2))


def _on_samples(name: str, vibration: Vibration, dt_s: float) -> FloatArray:
    """Return the parts of a shaper on samples."""
    wanted, instants_s = impulses(name, vibration)
    parts = np.zeros(floor(instants_s[-1] / dt_s + _ROUNDING) + 2)
    # A part later by one sample counts so much more and is turned so far.
    later = np.exp(complex(vibration.decay_per_s, -2.0 * pi * vibration.damped_hz) * dt_s)
    for part, instant_s in zip(wanted.tolist(), instants_s.tolist(), strict=True):
        at = floor(instant_s / dt_s + _ROUNDING)
        turned = part * later ** (instant_s / dt_s - at)
        second = turned.imag / later.imag
        parts[at] += turned.real - second * later.real
        parts[at + 1] += second
    return parts


#: Shapers of separate parts: the shares of an undamped vibration, and how far they are apart, in
#: periods.
PARTED: Mapping[str, tuple[tuple[float, ...], float]] = MappingProxyType(
    {
        "zv": ((1.0, 1.0), 0.5),
        "mzv": ((1.0, sqrt(2.0), 1.0), 0.375),
        "zvd": ((1.0, 2.0, 1.0), 0.5),
        "ei": ((1.0 + EI_VIBRATION, 2.0 - 2.0 * EI_VIBRATION, 1.0 + EI_VIBRATION), 0.5),
        "2hump_ei": (_two_humps(), 0.5),
        "3hump_ei": (_three_humps(), 0.5),
    }
)
#: Every shaper by the name it has as a ROS parameter.
SHAPERS: Mapping[str, Callable[[Vibration, float], FloatArray]] = MappingProxyType(
    {**{name: partial(_on_samples, name) for name in PARTED}, "jerk": _jerk}
)

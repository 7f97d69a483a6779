"""Reference shapers: parts of a change of the reference that leave one vibration at rest.

A shaper replaces each change of the reference by a few parts of it, which begin at different
instants. The vibrations that the parts excite cancel [1]_ [2]_ [3]_ [4]_. The parts stand on
samples. A part between two samples is split between them, so that its effect on the vibration stays
exact.

Shapers are compared by the figures that users of 3D printers know from the input shaping of their
firmware. A shaped toolhead cuts corners: smoothing is how far its path is off the corner that was
asked for, at a given acceleration. The remaining vibration is what of the spectrum stands above a
twentieth of its peak behind the shaper, over what stands above it before.

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

from dataclasses import dataclass
from functools import partial
from math import ceil, floor, pi, sqrt
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

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
ACCELERATION_MM_S2 = 5000.0
"""Acceleration at which the smoothing is stated."""
CORNER_MM_S = 5.0
"""Speed at which a corner is passed."""
LARGEST_SMOOTHING_MM = 0.12
"""Smoothing that shows in a print; it limits the acceleration."""
ALLOWED = 0.05
"""Vibration that may remain: a twentieth."""
# A higher frequency, which smooths less, is taken where so much more remains.
_WORTH = 0.01
_TRIED = 400


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


class SeenMode(NamedTuple):
    """Mode in one output.

    Attributes
    ----------
    vibration : Vibration
        Frequency and damping ratio.
    frequency_std_hz : float
        Standard deviation of the frequency.
    share : float
        Its part of the output's power.
    """

    vibration: Vibration
    frequency_std_hz: float
    share: float


@dataclass(frozen=True)
class ShaperFigures:
    """A shaper at its best frequency.

    Attributes
    ----------
    name : str
        Key of `shapers.PARTED`.
    vibration : Vibration
        Frequency and damping ratio that it is made for.
    remaining : float
        Remaining vibration over the measured spectrum, 0 to 1.
    at_modes : float
        Largest remaining vibration of a mode within two deviations of its frequency, by its share
        in units of the strongest mode's.
    smoothing_mm : float
        Distance of the path from a corner at `ACCELERATION_MM_S2`.
    largest_acceleration_mm_s2 : float
        Acceleration of the smoothing `LARGEST_SMOOTHING_MM`; 0 where corners alone have more.
    """

    name: str
    vibration: Vibration
    remaining: float
    at_modes: float
    smoothing_mm: float
    largest_acceleration_mm_s2: float

    @property
    def vibration_left(self) -> float:
        """The larger one of both remaining vibrations."""
        return max(self.remaining, self.at_modes)


def compared_shapers(
    frequencies_hz: FloatArray, density: FloatArray, modes: Sequence[SeenMode]
) -> tuple[ShaperFigures, ...]:
    """Return every shaper at the frequency at which it leaves the least vibration of an output.

    Parameters
    ----------
    frequencies_hz, density : ndarray, (frequencies,)
        Power spectral density of the output, in any unit.
    modes : sequence of SeenMode
        Modes in the output, one or more. The strongest one gives the damping ratio.
    """
    lowest, highest = (pick(mode.vibration.frequency_hz for mode in modes) for pick in (min, max))
    near = (frequencies_hz > 0.5 * lowest) & (frequencies_hz < 2.0 * highest)
    damping_ratio = max(modes, key=lambda mode: mode.share).vibration.damping_ratio
    tried = [
        Vibration(hz, damping_ratio)
        for hz in np.geomspace(0.7 * lowest, 2.0 * highest, _TRIED).tolist()
    ]
    found = []
    for name in PARTED:
        all_figures = [
            _figures(name, vibration, frequencies_hz[near], density[near], modes)
            for vibration in tried
        ]
        least = min(each.vibration_left for each in all_figures)
        found.append([each for each in all_figures if each.vibration_left <= least + _WORTH][-1])
    return tuple(found)


def recommended(compared: Sequence[ShaperFigures]) -> tuple[ShaperFigures, str]:
    """Return the shaper to take, and why: the one that smooths least of those that suffice."""
    usable = [each for each in compared if each.largest_acceleration_mm_s2] or compared
    enough = [each for each in usable if each.vibration_left <= ALLOWED]
    if enough:
        reason = f"it smooths least of those that leave at most {ALLOWED:.0%}"
        return min(enough, key=lambda each: each.smoothing_mm), reason
    best = min(usable, key=lambda each: each.vibration_left)
    return best, f"it leaves least, though more than {ALLOWED:.0%}: one shaper suits one mode"


def remaining_vibration(
    found: Impulses, frequencies_hz: FloatArray, damping_ratio: float
) -> FloatArray:
    """Return the vibration behind a shaper over that without it, (frequencies,)."""
    omega = 2.0 * pi * frequencies_hz[:, np.newaxis]
    pole = omega * complex(-damping_ratio, sqrt(1.0 - damping_ratio**2))
    ages_s = found.instants_s[-1] - found.instants_s
    return np.asarray(np.abs(np.exp(pole * ages_s) @ found.parts))


def smoothing_mm(found: Impulses, acceleration_mm_s2: float) -> float:
    """Return how far a path is off a corner: the larger one of a right angle and of a reversal."""
    right, reversal = _smoothing_terms(found)
    return max(right[0] + right[1] * acceleration_mm_s2, reversal * acceleration_mm_s2)


def _smoothing_terms(found: Impulses) -> tuple[tuple[float, float], float]:
    """Return smoothing at a right angle, constant and by acceleration, and that of a reversal.

    The path passes the corner when half of the change, in the mean, is done. Parts that come later
    are behind by their distances at the corner's speed and at the acceleration.
    """
    parts, after_s = found.parts, found.instants_s - found.parts @ found.instants_s
    late = after_s >= 0.0
    constant = sqrt(2.0) * CORNER_MM_S * float(parts[late] @ after_s[late])
    by_acceleration = sqrt(0.5) * float(parts[late] @ after_s[late] ** 2)
    return (constant, by_acceleration), 0.5 * float(parts @ after_s**2)


def _figures(
    name: str,
    vibration: Vibration,
    frequencies_hz: FloatArray,
    density: FloatArray,
    modes: Sequence[SeenMode],
) -> ShaperFigures:
    found = impulses(name, vibration)
    heard = density - ALLOWED * density.max()
    left = remaining_vibration(found, frequencies_hz, vibration.damping_ratio) * density
    remaining = np.maximum(left - ALLOWED * density.max(), 0.0).sum() / heard.clip(min=0.0).sum()
    strongest = max(mode.share for mode in modes)
    at_modes = max(mode.share / strongest * float(_at_mode(found, mode).max()) for mode in modes)
    right, reversal = _smoothing_terms(found)
    return ShaperFigures(
        name,
        vibration,
        float(remaining),
        at_modes,
        smoothing_mm(found, ACCELERATION_MM_S2),
        max(
            0.0, min((LARGEST_SMOOTHING_MM - right[0]) / right[1], LARGEST_SMOOTHING_MM / reversal)
        ),
    )


def _at_mode(found: Impulses, mode: SeenMode) -> FloatArray:
    frequency_hz, damping_ratio = mode.vibration
    around = frequency_hz + mode.frequency_std_hz * np.array([-2.0, 0.0, 2.0])
    return remaining_vibration(found, around, damping_ratio)

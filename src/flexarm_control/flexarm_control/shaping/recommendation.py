"""Comparison of the shapers on a measured spectrum, and the one to take.

The figures are those that users of 3D printers know from the input shaping of their firmware. A
shaped toolhead cuts corners: smoothing is how far its path is off the corner that was asked for, at
a given acceleration. The remaining vibration is what of the spectrum stands above a twentieth of
its peak behind the shaper, over what stands above it before.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_control.shaping.shapers import PARTED, Vibration, impulses

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.shaping.shapers import Impulses
    from flexarm_core.arrays import FloatArray

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

"""Multisine of a chosen band, with a small crest factor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from flexarm_core.errors import SettingError
from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray

_GROUP: Final = 4
"""Of so many odd lines in a row, one is left out, by which odd distortion shows."""
_MOST_LINES: Final = 20_000
_OVERSAMPLING: Final = 16
_CLIPPINGS: Final = 150
_CLIPS: Final = 0.7, 0.95
_ROUNDING_S = 1e-9


@dataclass(frozen=True)
class Band(Bounded):
    """Frequencies of a wave, and its period.

    Raises
    ------
    SettingError
        When a value is outside its range, or no line lies in the band.
    """

    low_hz: float = setting(0.2, 0.001, 5000.0, "Hz", "lowest frequency of the band")
    high_hz: float = setting(50.0, 0.001, 5000.0, "Hz", "highest frequency of the band")
    period_s: float = setting(10.0, 0.01, 3600.0, "s", "period of a multisine, chirp or sequence")
    odd: bool = field(
        default=False,
        metadata={"description": "multisine: odd lines alone, of which one in four is left out"},
    )
    octaves: bool = field(
        default=False,
        metadata={"description": "multisine: equal power in each octave, not at each line"},
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.low_hz < self.high_hz:
            raise SettingError(
                f"low_hz = {self.low_hz:g} must be below high_hz = {self.high_hz:g}: exchange them"
            )
        if self.high_hz * self.period_s > _MOST_LINES:
            raise SettingError(
                f"period_s = {self.period_s:g} up to high_hz = {self.high_hz:g} has more than "
                f"{_MOST_LINES} lines: choose a shorter period"
            )
        if not len(self.harmonics):
            raise SettingError(
                f"no line of period_s = {self.period_s:g} lies between low_hz = {self.low_hz:g} "
                f"and high_hz = {self.high_hz:g}: choose a longer period"
            )

    @property
    def harmonics(self) -> NDArray[np.int64]:
        """Numbers of the lines in the band, of the odd ones alone if so asked."""
        first = max(1, math.ceil(self.low_hz * self.period_s - _ROUNDING_S))
        last = math.floor(self.high_hz * self.period_s + _ROUNDING_S)
        lines = np.arange(first, last + 1)
        return lines[lines % 2 == 1] if self.odd else lines


@dataclass(frozen=True, eq=False)
class Multisine:
    """Sum of cosines with a peak of 1.

    Attributes
    ----------
    period_s : float
        Its period, s.
    harmonics : ndarray of int, (lines,)
        Numbers of its lines.
    amplitudes : ndarray, (lines,)
        Amplitudes of the lines.
    phases : ndarray, (lines,)
        Phases, rad.
    """

    period_s: float
    harmonics: NDArray[np.int64]
    amplitudes: FloatArray
    phases: FloatArray

    def __call__(self, time_s: float) -> float:
        """Return the value at a time, within -1 to 1."""
        turned = math.tau * ((time_s / self.period_s) % 1.0)
        value = float(self.amplitudes @ np.cos(self.harmonics * turned + self.phases))
        return min(max(value, -1.0), 1.0)


def multisine(band: Band, seed: int) -> Multisine:
    """Return a multisine with random phases and a small crest factor.

    The phases of the seed are improved by clipping (Van der Ouderaa, Schoukens and Renneboog, "Peak
    factor minimization using a time-frequency domain swapping algorithm", IEEE Transactions on
    Instrumentation and Measurement 37, 1988). It begins where its integral crosses zero, so that an
    arm without friction that begins at rest does not drift.

    Parameters
    ----------
    band : Band
        Its lines; of odd ones, one of each four in a row is left out at random.
    seed : int
        Seed of the phases and of the lines that are left out.
    """
    random = np.random.default_rng(seed)
    harmonics = band.harmonics
    if band.odd:
        left_out = np.arange(0, len(harmonics), _GROUP)
        left_out = left_out + random.integers(0, _GROUP, len(left_out))
        kept = np.setdiff1d(np.arange(len(harmonics)), left_out)
        harmonics = harmonics[kept] if len(kept) else harmonics
    sizes = harmonics**-0.5 if band.octaves else np.ones(len(harmonics))
    samples = 1 << int(_OVERSAMPLING * harmonics[-1]).bit_length()
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    best_peak, best = math.inf, spectrum
    phases = random.uniform(0.0, math.tau, len(harmonics))
    for clip in np.linspace(*_CLIPS, _CLIPPINGS):
        spectrum[harmonics] = sizes * np.exp(1j * phases)
        wave = np.fft.irfft(spectrum, samples)
        peak = float(np.abs(wave).max())
        if peak < best_peak:
            best_peak, best = peak, spectrum.copy()
        clipped = np.fft.rfft(np.clip(wave, -clip * peak, clip * peak))
        phases = np.angle(clipped[harmonics])
    wave = np.fft.irfft(best, samples)
    integral = np.zeros_like(best)
    integral[harmonics] = best[harmonics] / (1j * harmonics)
    ground = np.fft.irfft(integral, samples)
    crossings = np.flatnonzero(np.sign(ground) != np.sign(np.roll(ground, -1)))
    place = crossings[np.argmin(np.abs(wave[crossings]))]
    before, after = ground[place], ground[(place + 1) % samples]
    start = float(place + before / (before - after))
    turned = np.angle(best[harmonics]) + math.tau * start / samples * harmonics
    amplitudes = np.asarray(sizes * (2.0 / samples / best_peak), dtype=np.float64)
    return Multisine(band.period_s, harmonics, amplitudes, np.angle(np.exp(1j * turned)))

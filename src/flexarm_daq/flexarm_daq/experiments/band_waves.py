"""Chirp, binary sequence and noise of a chosen band, of unit magnitude."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_core.waves import Band

_ROUNDING_S = 1e-9
# A held bit has half of its power below 0.44 of the clock's frequency.
_BIT_PERIODS: Final = 0.44
# Taps of maximum-length shift registers (Golomb, "Shift Register Sequences", 1967).
_TAPS: Final = {
    3: (3, 2),
    4: (4, 3),
    5: (5, 3),
    6: (6, 5),
    7: (7, 6),
    8: (8, 6, 5, 4),
    9: (9, 5),
    10: (10, 7),
    11: (11, 9),
    12: (12, 11, 10, 4),
    13: (13, 12, 11, 8),
    14: (14, 13, 12, 2),
    15: (15, 14),
    16: (16, 15, 13, 4),
    17: (17, 14),
}
_DEVIATIONS: Final = 3.0
_STEPS_A_PERIOD: Final = 8.0
_FILTER_ORDER: Final = 4


def chirp(band: Band, time_s: float) -> float:
    """Return a cosine whose frequency rises evenly through the band, again in each period."""
    passed_s = time_s % band.period_s
    rise = (band.high_hz - band.low_hz) / band.period_s
    return math.cos(math.tau * (band.low_hz + 0.5 * rise * passed_s) * passed_s)


@dataclass(frozen=True, eq=False)
class BinarySequence:
    """Pseudo-random sequence of maximum length, whose bits are held.

    Attributes
    ----------
    bits : ndarray, (2**n - 1,)
        1 or -1.
    bit_s : float
        Time for which one is held, s.
    """

    bits: FloatArray
    bit_s: float

    def __call__(self, time_s: float) -> float:
        """Return the bit at a time."""
        return float(self.bits[int((time_s + _ROUNDING_S) / self.bit_s) % len(self.bits)])


def binary_sequence(band: Band, seed: int) -> BinarySequence:
    """Return a sequence with half of its power below the band's end, and at least its period.

    The seed chooses where it begins. The lowest frequency is that of its period.

    Raises
    ------
    SettingError
        When the period has more bits than the longest register.
    """
    bit_s = _BIT_PERIODS / band.high_hz
    wanted = band.period_s / bit_s
    register = next((each for each in _TAPS if 2**each - 1 >= wanted), None)
    if register is None:
        raise SettingError(
            f"a sequence of period_s = {band.period_s:g} at high_hz = {band.high_hz:g} has "
            f"{wanted:.0f} bits: choose a shorter period"
        )
    state = [1] * register
    bits = np.empty(2**register - 1)
    for place in range(len(bits)):
        bits[place] = 1.0 if state[-1] else -1.0
        state = [sum(state[tap - 1] for tap in _TAPS[register]) % 2, *state[:-1]]
    start = int(np.random.default_rng(seed).integers(len(bits)))
    return BinarySequence(np.roll(bits, -start), bit_s)


class BandNoise:
    """Noise of a band: Gaussian, cut off at three deviations, which are its magnitude 1.

    Parameters
    ----------
    band : Band
        Its band, between which a Butterworth filter passes it.
    seed : int
        Seed of the noise.
    """

    def __init__(self, band: Band, seed: int) -> None:
        self._rate_hz = _STEPS_A_PERIOD * band.high_hz
        # It takes a moment to load, and the other waves do without it.
        from scipy import signal  # noqa: PLC0415

        self._passed = signal.sosfilt
        edges = [band.low_hz, band.high_hz]
        self._filter = signal.butter(
            _FILTER_ORDER, edges, "bandpass", fs=self._rate_hz, output="sos"
        )
        share = 2.0 * (band.high_hz - band.low_hz) / self._rate_hz
        self._scale = 1.0 / (_DEVIATIONS * math.sqrt(share))
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        """Begin again from the start."""
        self._random = np.random.default_rng(self._seed)
        self._state = np.zeros((len(self._filter), 2))
        self._block = np.zeros(0)
        self._begins = 0

    def __call__(self, time_s: float) -> float:
        """Return the value at a time that does not decrease."""
        place = int((time_s + _ROUNDING_S) * self._rate_hz)
        while place >= self._begins + len(self._block):
            self._begins += len(self._block)
            white = self._scale * self._random.standard_normal(math.ceil(self._rate_hz))
            self._block, self._state = self._passed(self._filter, white, zi=self._state)
        return float(np.clip(self._block[place - self._begins], -1.0, 1.0))

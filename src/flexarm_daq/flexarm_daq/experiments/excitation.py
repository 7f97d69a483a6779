"""Excitation signals: those of the thesis (2.4.1, 2.4.2), and of a chosen band.

An excitation is a pure stepper: time and position in, command out. The same seed gives the same
signal. Choices that the thesis leaves open are marked as chosen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from flexarm_core.channels import BOUND_V, TRAVEL_V
from flexarm_core.errors import SettingError
from flexarm_core.waves import Band, multisine

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flexarm_core.arrays import FloatArray

DIRECTION_HZ: Final = 0.5
"""Frequency at which the direction alternates (2.4.1, items 1 and 2)."""
VARYING_HZ: Final = (0.6, 3.0)
"""Frequencies of the varying square waveform (2.4.1, item 3)."""
HOLD_S: Final = 0.01
"""Hold time of a random magnitude unless told otherwise. Chosen here: its spectrum is flat over the
modes below 50 Hz."""
PULSE_S: Final = 0.1
"""Length of a pulse; another one of the other sign follows it and stops the arm."""
PAUSE_S: Final = 0.3
"""Pause behind a pair of pulses."""
MOVED_V: Final = TRAVEL_V / 20.0
"""Way of a joint at which it has moved for certain, and by more than the play of a good gear: 4
degrees of the thesis's arm."""
_FIRST_PULSE: Final = 1.0 / 32.0
_GROWTH: Final = math.sqrt(2.0)
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


class Excitation(Protocol):
    """Signal that excites the arm."""

    def step(self, time_s: float, angle_v: float) -> float:
        """Return the command at a sample, V.

        Parameters
        ----------
        time_s : float
            Time since the start, s; must not decrease between two calls of `reset`.
        angle_v : float
            Measured position, V.
        """

    def reset(self) -> None:
        """Begin again from the start."""


@dataclass
class Held:
    """Random numbers of a seed, uniform on [0, 1), each held for a time."""

    seed: int
    hold_s: float = HOLD_S

    def __post_init__(self) -> None:
        self.reset()

    def at(self, time_s: float) -> float:
        """Return the number at a time that does not decrease."""
        index = int((time_s + _ROUNDING_S) / self.hold_s)
        while self._index < index:
            self._index += 1
            self._value = float(self._random.random())
        return self._value

    def reset(self) -> None:
        """Begin again from the start."""
        self._random = np.random.default_rng(self.seed)
        self._index = -1
        self._value = 0.0


@dataclass
class Square:
    """Constant magnitude whose direction alternates at 0.5 Hz (2.4.1, item 1; Figure 2-5a).

    The signal begins in the middle of a half-period, so that the arm swings about its start. That
    is chosen: a whole half-period at first would take the arm to one side only.
    """

    magnitude_v: float

    def step(self, time_s: float, angle_v: float) -> float:  # noqa: ARG002 - the protocol has it
        """Return the command at a sample; see `Excitation.step`."""
        return self.magnitude_v * alternating(time_s)

    def reset(self) -> None:
        """Do nothing: the signal has no state."""


@dataclass
class _HeldRandom:
    """Base of the signals whose magnitude is random, V."""

    magnitude_v: float
    seed: int
    hold_s: float = HOLD_S

    def __post_init__(self) -> None:
        self._held = Held(self.seed, self.hold_s)

    def reset(self) -> None:
        """Begin again from the start."""
        self._held.reset()


@dataclass
class PeriodicRandom(_HeldRandom):
    """Random magnitude whose direction alternates at 0.5 Hz (2.4.1, item 2; Figure 2-5b).

    The magnitude is uniformly distributed from 0 to `magnitude_v`.
    """

    def step(self, time_s: float, angle_v: float) -> float:  # noqa: ARG002 - the protocol has it
        """Return the command at a sample; see `Excitation.step`."""
        return self.magnitude_v * self._held.at(time_s) * alternating(time_s)


@dataclass
class VaryingSquare:
    """Constant magnitude whose direction alternates at 0.6 to 3 Hz (2.4.1, item 3; Figure 2-5c).

    Each period has its own frequency, uniformly distributed over the range, and begins in the
    middle of a half-period as in `Square`. Each period therefore returns a frictionless arm to its
    start. That is chosen: with independent half-periods the arm drifts into its stops.
    """

    magnitude_v: float
    seed: int
    _period_s: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.reset()

    def step(self, time_s: float, angle_v: float) -> float:  # noqa: ARG002 - the protocol has it
        """Return the command at a sample; see `Excitation.step`."""
        while time_s + _ROUNDING_S >= self._start_s + self._period_s:
            self._start_s += self._period_s
            self._period_s = self._random_period_s()
        return self.magnitude_v * direction((time_s + _ROUNDING_S - self._start_s) / self._period_s)

    def reset(self) -> None:
        """Begin again from the start."""
        self._random = np.random.default_rng(self.seed)
        self._start_s = 0.0
        self._period_s = self._random_period_s()

    def _random_period_s(self) -> float:
        return 1.0 / float(self._random.uniform(*VARYING_HZ))


@dataclass
class Random(_HeldRandom):
    """Random magnitude and direction (2.4.1, item 4; Figure 2-5d).

    The command is uniformly distributed between both signs of `magnitude_v`.
    """

    def step(self, time_s: float, angle_v: float) -> float:  # noqa: ARG002 - the protocol has it
        """Return the command at a sample; see `Excitation.step`."""
        return self.magnitude_v * (2.0 * self._held.at(time_s) - 1.0)


@dataclass
class Bounded:
    """Direction that turns when the position reaches a bound (2.4.2; Figure 2-10).

    The arm first moves towards the positive bound.

    Attributes
    ----------
    magnitude_v : float
        Magnitude, V; the largest one when it is random.
    held : Held or None
        Random magnitudes as a share of the largest (Figure 2-10b); None for a constant one (Figure
        2-10a).
    bound_v : float
        Bound of the position, V.
    """

    magnitude_v: float
    held: Held | None = None
    bound_v: float = BOUND_V
    _direction: float = field(default=1.0, init=False, repr=False)

    def step(self, time_s: float, angle_v: float) -> float:
        """Return the command at a sample; see `Excitation.step`."""
        if self._direction * angle_v >= self.bound_v:
            self._direction = -self._direction
        share = 1.0 if self.held is None else self.held.at(time_s)
        return self._direction * self.magnitude_v * share

    def reset(self) -> None:
        """Begin again from the start."""
        self._direction = 1.0
        if self.held is not None:
            self.held.reset()


@dataclass
class Wave:
    """Wave that is a function of time alone.

    Attributes
    ----------
    magnitude_v : float
        Its magnitude, V.
    wave : callable
        Wave of magnitude 1.
    """

    magnitude_v: float
    wave: Callable[[float], float]

    def step(self, time_s: float, angle_v: float) -> float:  # noqa: ARG002 - the protocol has it
        """Return the command at a sample; see `Excitation.step`."""
        return self.magnitude_v * self.wave(time_s)

    def reset(self) -> None:
        """Begin again from the start: noise alone has a state."""
        if isinstance(self.wave, BandNoise):
            self.wave.reset()


@dataclass
class Pulses:
    """Pairs of short pulses, up and down, that grow until the joint has moved.

    A pair leaves an arm that rests where it began nearly at rest, whether inertia, friction or a
    spring holds it. Each pair is higher than the last one by a factor of the root of 2.

    Attributes
    ----------
    magnitude_v : float
        Height of the highest pair, V.
    moved_v : float
        Way from the start at which no further pair follows, V.
    """

    magnitude_v: float
    moved_v: float = MOVED_V
    _start_v: float | None = field(default=None, init=False, repr=False)
    _number: float = field(default=-1.0, init=False, repr=False)
    _height_v: float = field(default=0.0, init=False, repr=False)
    _has_moved: bool = field(default=False, init=False, repr=False)

    def step(self, time_s: float, angle_v: float) -> float:
        """Return the command at a sample; see `Excitation.step`."""
        if self._start_v is None:
            self._start_v = angle_v
        number, in_pair_s = divmod(time_s + _ROUNDING_S, PAUSE_S + 2.0 * PULSE_S)
        self._has_moved |= abs(angle_v - self._start_v) >= self.moved_v
        if number > self._number:
            self._number = number
            share = 0.0 if self._has_moved else min(_FIRST_PULSE * _GROWTH**number, 1.0)
            self._height_v = self.magnitude_v * share
        into_s = in_pair_s - PAUSE_S
        if into_s < 0.0:
            return 0.0
        return self._height_v if into_s < PULSE_S else -self._height_v

    def reset(self) -> None:
        """Begin again from the start."""
        self._start_v = None
        self._number, self._height_v, self._has_moved = -1.0, 0.0, False


def alternating(time_s: float) -> float:
    """Return a direction that alternates at `DIRECTION_HZ`; see `direction`."""
    return direction(DIRECTION_HZ * (time_s + _ROUNDING_S))


def direction(periods: float) -> float:
    """Return the direction after some periods, the first from mid positive half-period on."""
    return 1.0 if (periods + 0.25) % 1.0 < 0.5 else -1.0  # noqa: PLR2004 - half a period


class MakeExcitation(Protocol):
    """Way to make an excitation."""

    def __call__(self, magnitude_v: float, seed: int, band: Band = ..., /) -> Excitation:
        """Return an excitation of a magnitude, V, and a seed, and of a band where it has one."""


def _of_band(wave: Callable[..., Callable[[float], float]]) -> MakeExcitation:
    usual = Band()
    return lambda magnitude_v, seed, band=usual: Wave(magnitude_v, wave(band, seed))


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


#: Every excitation by its name, made from magnitude and seed, and from the band where it has one.
EXCITATIONS: Final[Mapping[str, MakeExcitation]] = MappingProxyType(
    {
        "square": lambda magnitude_v, *_: Square(magnitude_v),
        "periodic_random": lambda magnitude_v, seed, *_: PeriodicRandom(magnitude_v, seed),
        "varying_square": lambda magnitude_v, seed, *_: VaryingSquare(magnitude_v, seed),
        "random": lambda magnitude_v, seed, *_: Random(magnitude_v, seed),
        "bounded_constant": lambda magnitude_v, *_: Bounded(magnitude_v),
        "bounded_random": lambda magnitude_v, seed, *_: Bounded(magnitude_v, Held(seed)),
        "multisine": _of_band(multisine),
        "chirp": _of_band(lambda band, _: partial(chirp, band)),
        "binary_sequence": _of_band(binary_sequence),
        "band_noise": _of_band(BandNoise),
        "pulses": lambda magnitude_v, *_: Pulses(magnitude_v),
    }
)

"""Gain, phase and disk margins of the PDP loop (4-2), with every crossing, and those asked for.

The disk margin bounds simultaneous gain and phase errors, where the classical margins bound one at
a time. The loop stays stable for every factor in the disk that meets the real axis at (2 - a)/(2 +
a) and (2 + a)/(2 - a) [1]_.

References
----------
.. [1] Seiler, P., Packard, A., and Gahinet, P. (2020). An introduction to disk margins. IEEE
   Control Systems Magazine 40(5), 78-95.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_control.models.arm_model import (
    MIDDLE_STRAIN,
    POSITION,
    SPEED,
    check_arm_model,
    delayed,
)
from flexarm_core.errors import SettingError
from flexarm_ident.fitting.validation import frequency_response

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control

    from flexarm_control.laws.gains import PdpGains
    from flexarm_core.arrays import ComplexArray, FloatArray

_SLOW_FREQUENCIES, _FREQUENCIES = 1500, 7500
_SLOWEST = 1e-5
LOWEST_HZ = 0.2
"""Frequency below which crossings do not count, Hz: slow poles are those of friction."""
# Largest margins in the search, whose arithmetic needs finite numbers.
_MOST_DB, _MOST_DEG = 60.0, 180.0
# A longer delay adds many states to the models, and no loop of the arm is stable with it.
_MOST_DELAY_S = 0.05
_MOST_DURATION_S = 60.0
_ACTIVE_WITHIN_DB, _ACTIVE_WITHIN_DEG = 0.1, 0.5


class Crossing(NamedTuple):
    """Frequency at which the loop crosses gain one or phase -180 deg.

    Attributes
    ----------
    frequency_hz : float
        Frequency, Hz.
    margin : float
        At phase -180 deg the factor from the gain to one, dB; at gain one the phase above -180 deg,
        between -180 and 180 deg.
    """

    frequency_hz: float
    margin: float


@dataclass(frozen=True)
class Margins:
    """Margins of one loop.

    The margins are those of the crossing closest to instability. The two classical margins are
    distances: positive when the closed loop is stable and negative when it is not.

    Attributes
    ----------
    gain_margin_db, gain_margin_hz : float
        Gain margin, dB (infinite for none), and its frequency, Hz (NaN for none).
    phase_margin_deg, phase_margin_hz : float
        Phase margin, deg, and its frequency, Hz.
    phase_crossings, gain_crossings : tuple of Crossing
        Every crossing of -180 deg, margins in dB, and of gain one, margins in deg.
    disk_margin, disk_margin_hz : float
        Symmetric disk margin a = min 2 |1 + L| / |1 - L|, zero for an unstable loop, and its
        frequency, Hz.
    stable : bool
        True if all poles of the closed loop lie inside the unit circle.
    """

    gain_margin_db: float
    gain_margin_hz: float
    phase_margin_deg: float
    phase_margin_hz: float
    phase_crossings: tuple[Crossing, ...]
    gain_crossings: tuple[Crossing, ...]
    disk_margin: float
    disk_margin_hz: float
    stable: bool


@dataclass(frozen=True, eq=False)
class Loop:
    """Open loop L = forward / inner of one model and its controller, by its response.

    Attributes
    ----------
    frequency_hz : ndarray, (frequencies,)
        Frequencies, Hz, of `margin_frequencies_hz`.
    forward, inner : ndarray of complex, (frequencies,)
        Numerator and denominator of the loop, both without poles of the other.
    stable : bool
        Whether the closed loop is stable.
    """

    frequency_hz: FloatArray
    forward: ComplexArray
    inner: ComplexArray
    stable: bool

    @property
    def response(self) -> ComplexArray:
        """The loop L, (frequencies,)."""
        return self.forward / self.inner

    @property
    def sensitivity(self) -> ComplexArray:
        """The sensitivity S = 1 / (1 + L), (frequencies,)."""
        return self.inner / (self.inner + self.forward)

    def margins(self, lowest_hz: float = LOWEST_HZ) -> Margins:
        """Return the margins; `lowest_hz` as in the function `margins`.

        A search asks for them hundreds of times, and they take 2 ms here. On the same frequencies
        python-control's `stability_margins` takes 400 times as long and more, and leaves out a loop
        that ends on the negative axis at half the sampling rate; on its own it finds crossings that
        are none. Its `disk_margins` takes 0.6 s.
        """
        frequency_hz, forward, inner = self.frequency_hz, self.forward, self.inner
        phase_crossings = _phase_crossings(frequency_hz, forward, inner)
        gain_crossings = _gain_crossings(frequency_hz, forward, inner)
        counts = frequency_hz >= lowest_hz
        # 1 + L and 1 - L are both multiplied by the inner loop, which has no poles of its own.
        with np.errstate(divide="ignore"):
            sizes = 2.0 * np.abs(inner + forward)[counts] / np.abs(inner - forward)[counts]
        nearest = int(np.argmin(sizes))
        sign = 1.0 if self.stable else -1.0
        gain = _closest([c for c in phase_crossings if c.frequency_hz >= lowest_hz])
        # A slow loop has its crossover below the limit; the last crossing then counts.
        phase = _closest(
            [c for c in gain_crossings if c.frequency_hz >= lowest_hz] or list(gain_crossings[-1:])
        )
        return Margins(
            gain_margin_db=sign * abs(gain.margin),
            gain_margin_hz=gain.frequency_hz,
            phase_margin_deg=sign * abs(phase.margin),
            phase_margin_hz=phase.frequency_hz,
            phase_crossings=phase_crossings,
            gain_crossings=gain_crossings,
            disk_margin=float(sizes[nearest]) if self.stable else 0.0,
            disk_margin_hz=float(frequency_hz[counts][nearest]),
            stable=self.stable,
        )


class LoopResponse:
    """Loop (4-2) of one model, for evaluation with many gains; parameters as for `margins`."""

    def __init__(
        self, model: control.StateSpace, *, delay_s: float = 0.0, lowest_hz: float = LOWEST_HZ
    ) -> None:
        check_arm_model(model)
        self.model = delayed(model, delay_s)
        self._lowest_hz = lowest_hz
        self._frequency_hz = margin_frequencies_hz(model)
        self._response = frequency_response(self.model, self._frequency_hz)[..., 0]

    def loop(self, gains: PdpGains) -> Loop:
        """Return the loop with these gains."""
        position, strain, speed = self._response[:, [POSITION, MIDDLE_STRAIN, SPEED]].T
        return Loop(
            self._frequency_hz,
            gains.kp * position,
            1.0 + gains.ksg * strain + gains.kd * speed,
            stable=self._is_stable(gains),
        )

    def margins(self, gains: PdpGains) -> Margins:
        """Return the margins for these gains."""
        return self.loop(gains).margins(self._lowest_hz)

    def _is_stable(self, gains: PdpGains) -> bool:
        A, B, C, D = self.model.A, self.model.B, self.model.C, self.model.D
        feedback = np.array([[gains.kp, 0.0, gains.ksg, gains.kd]])
        closed = A - B @ feedback @ C / (1.0 + (feedback @ D).item())
        return bool(np.max(np.abs(np.linalg.eigvals(closed))) < 1.0)


def margin_frequencies_hz(model: control.StateSpace) -> FloatArray:
    """Return the frequencies of a search for crossings, Hz, up to half the sampling rate."""
    nyquist_hz = 0.5 / model.dt
    frequency_hz: FloatArray = np.union1d(
        np.geomspace(_SLOWEST * nyquist_hz, 0.01 * nyquist_hz, _SLOW_FREQUENCIES),
        np.linspace(0.01 * nyquist_hz, nyquist_hz, _FREQUENCIES),
    )
    return frequency_hz


def margins(
    model: control.StateSpace,
    gains: PdpGains,
    *,
    delay_s: float = 0.0,
    lowest_hz: float = LOWEST_HZ,
) -> Margins:
    """Return gain, phase and disk margins of the PDP loop (4-2), opened at the position error.

    Parameters
    ----------
    model : control.StateSpace
        Model of the arm: one input, the four outputs of the thesis, dt set.
    gains : PdpGains
        Gains of the PDP law; a PD law is one with ``ksg=0``.
    delay_s : float
        Time from a sample to the instant at which its command acts, s.
    lowest_hz : float
        Frequency below which crossings do not count, Hz, unless there is no crossing of gain one
        above. The slow poles of a model printed to four decimals are not those of the arm.

    Returns
    -------
    Margins
        Margins, every crossing, and the stability of the closed loop.

    Raises
    ------
    SettingError
        When the model is not one of the arm or the delay is negative.

    Examples
    --------
    >>> from flexarm_control import PdpGains, nominal_model
    >>> from flexarm_control.design.margins import margins
    >>> found = margins(nominal_model(0.0), PdpGains(kp=0.5, kd=3.3, ksg=0.07))
    >>> round(found.gain_margin_db, 1), round(found.gain_margin_hz, 2)
    (11.2, 0.96)
    """
    return LoopResponse(model, delay_s=delay_s, lowest_hz=lowest_hz).margins(gains)


def _closest(crossings: list[Crossing]) -> Crossing:
    return min(crossings, key=lambda c: abs(c.margin), default=Crossing(nan, inf))


def _phase_crossings(
    frequency_hz: FloatArray, forward: ComplexArray, inner: ComplexArray
) -> tuple[Crossing, ...]:
    found = []
    for i, share in _sign_changes(forward, inner, lambda a, b: (a * b.conj()).imag):
        value = _between(forward, i, share) / _between(inner, i, share)
        if value.real < 0.0:
            found.append(Crossing(_between(frequency_hz, i, share).real, _missing_gain_db(value)))
    # At half the sampling rate the loop is real: it ends on the axis without crossing it.
    end = complex(forward[-1] / inner[-1])
    if end.real < 0.0 and (not found or found[-1].frequency_hz < frequency_hz[-2]):
        found.append(Crossing(float(frequency_hz[-1]), _missing_gain_db(end)))
    return tuple(found)


def _gain_crossings(
    frequency_hz: FloatArray, forward: ComplexArray, inner: ComplexArray
) -> tuple[Crossing, ...]:
    found = []
    for i, share in _sign_changes(
        forward + inner, forward - inner, lambda a, b: (a * b.conj()).real
    ):
        value = _between(forward, i, share) / _between(inner, i, share)
        phase_deg = float(np.degrees(np.angle(-value)))
        found.append(Crossing(_between(frequency_hz, i, share).real, phase_deg))
    return tuple(found)


def _sign_changes(
    first: ComplexArray,
    second: ComplexArray,
    form: Callable[[ComplexArray, ComplexArray], FloatArray],
) -> list[tuple[int, float]]:
    """Return the sign changes of a form of two responses: index, and share of the next interval.

    The inner loop can be far less damped than the plant. The responses of the plant are therefore
    interpolated instead of the loop: the form is then a polynomial of second degree in the share.
    """
    above = form(first, second) >= 0.0
    found = []
    for i in np.flatnonzero(above[1:] != above[:-1]):
        a, b = first[i : i + 2], second[i : i + 2]
        da, db = a[1] - a[0], b[1] - b[0]
        roots = np.roots([form(da, db), form(da, b[0]) + form(a[0], db), form(a[0], b[0])])
        found.append((int(i), float(roots[np.argmin(np.abs(roots - 0.5))].real)))
    return found


def _between(values: ComplexArray | FloatArray, i: int, share: float) -> complex:
    return complex(values[i] + share * (values[i + 1] - values[i]))


def _missing_gain_db(value: complex) -> float:
    return float(-20.0 * np.log10(abs(value)))


@dataclass(frozen=True)
class Requirements:
    """Criterion (4-3) and least margins of a tuning over several models.

    Attributes
    ----------
    error_weight, strain_weight : float
        W_E and W_sg of (4-3), not both zero.
    gain_margin_db, phase_margin_deg : float
        Least margins on every model, above 0 and at most 60 dB and below 180 deg.
    duration_s : float
        Length of the step of the criterion, above 0 and at most 60 s.

    Raises
    ------
    SettingError
        When a value is out of its range.
    """

    error_weight: float = 0.5
    strain_weight: float = 0.5
    gain_margin_db: float = 10.0
    phase_margin_deg: float = 55.0
    duration_s: float = 5.0

    def __post_init__(self) -> None:
        for name in ("error_weight", "strain_weight"):
            if not 0.0 <= (weight := getattr(self, name)) < np.inf:
                raise SettingError(f"{name} = {weight:g}; must be finite and not negative")
        if self.error_weight == self.strain_weight == 0.0:
            raise SettingError("error_weight = 0 and strain_weight = 0; one must be above 0")
        if not 0.0 < self.gain_margin_db <= _MOST_DB:
            raise SettingError(
                f"gain_margin_db = {self.gain_margin_db:g} dB; must be above 0 and at most "
                f"{_MOST_DB:g} dB"
            )
        if not 0.0 < self.phase_margin_deg < _MOST_DEG:
            raise SettingError(
                f"phase_margin_deg = {self.phase_margin_deg:g} deg; must be above 0 and below"
                f" {_MOST_DEG:g} deg"
            )
        check_duration(self.duration_s)

    def criterion(self, parts: FloatArray) -> float:
        """Return J of (4-3) for E and Y of every model, (models, 2)."""
        errors, strains = parts.sum(axis=0)
        return float(self.error_weight * errors + self.strain_weight * strains)

    def excess(self, found: Sequence[Margins]) -> FloatArray:
        """Return how far margins lie above the least ones, dB and then deg, (2 models,)."""
        gain = np.clip([m.gain_margin_db for m in found], -_MOST_DB, _MOST_DB)
        phase = np.clip([m.phase_margin_deg for m in found], -_MOST_DEG, _MOST_DEG)
        return np.concatenate([gain - self.gain_margin_db, phase - self.phase_margin_deg])

    def active(self, found: Sequence[Margins]) -> list[str]:
        """Return the margins that stop the search, in words."""
        active = []
        for number, margin in enumerate(found, start=1):
            if margin.gain_margin_db <= self.gain_margin_db + _ACTIVE_WITHIN_DB:
                active.append(f"gain margin of model {number}")
            if margin.phase_margin_deg <= self.phase_margin_deg + _ACTIVE_WITHIN_DEG:
                active.append(f"phase margin of model {number}")
        return active


def check_duration(duration_s: float) -> None:
    """Raise a SettingError for a length of the criterion's step that cannot be used, s."""
    if not 0.0 < duration_s <= _MOST_DURATION_S:
        raise SettingError(
            f"duration_s = {duration_s:g}; must be above 0 and at most {_MOST_DURATION_S:g} s"
        )


def check_delay(delay_s: float) -> None:
    """Refuse a loop delay that a tuning does not take.

    Raises
    ------
    SettingError
        When it is negative or above 0.05 s.
    """
    if not 0.0 <= delay_s <= _MOST_DELAY_S:
        raise SettingError(f"delay_s = {delay_s:g} s; must be 0 to {_MOST_DELAY_S:g} s")

"""Payload at the tip, estimated from the motion (chapter 5, future work 1).

Seen from the hub the arm is a cantilever with the payload at its end. The base gauge y2 measures
how far the cantilever is bent, the tachometer y4 how its root is turned::

    a d2(y2)/dt2 + y2 = a K d(y4)/dt,    a = m L^3 / (3 EI)

`a` is the tip mass over the stiffness of the cantilever, so it is affine in the payload; `K` holds
only the stiffness and the gains of the two sensors. Neither motor nor friction enters. The
equation is filtered by a Butterworth low-pass as a state variable filter [1]_, which gives the
derivatives, and solved for `a` by instrumental variables [2]_: the instrument is the bending of a
cantilever of known payload that the same speed drives. It carries no noise of the gauge, so that
noise does not bias the estimate. Of several such cantilevers the one counts that the estimate
comes closest to, as in the refined method of [1]_. Only samples in motion count.

References
----------
.. [1] Young, P. (1981). Parameter estimation for continuous-time models: a survey. Automatica
   17(1), 23-39.
.. [2] Soderstrom, T., and Stoica, P. (1983). Instrumental Variable Methods for System
   Identification. Springer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import expm

from flexarm_core.specs import Bounded, limits

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

MAX_PAYLOAD_KG = 1.0
"""Heaviest payload that an estimate may name."""

_FILTER_ORDER = 3
_INSTRUMENT_PAYLOADS_KG = np.array([0.0, 0.1, 0.2, 0.3, 0.45, 0.7, 1.0])
_INSTRUMENT_DAMPING = 0.05
_BASE_STRAIN, _SPEED = 1, 3
_PLAUSIBLE_V = 100.0
"""Ten times the range of the converter: what is beyond, or no number, is no measurement."""
_MOVING_V = 0.01
"""Speed signal after the low-pass, some times the noise of the tachometer."""


@dataclass(frozen=True)
class PayloadDetection(Bounded):
    """Settings of the payload estimator.

    Attributes
    ----------
    cantilever_n_per_m
        Stiffness 3 EI / L^3 of the arm as a cantilever; the default is that of section 2.3.
    tare_kg
        What an arm without payload weighs at its tip: its own share, the holder and the higher
        modes. A move without payload measures it: the estimate plus the tare in force.
    strain_per_speed_s2
        K: base gauge over tachometer, both in V; (L - x) 3 EI / L^2 times the gains of the sensors.
    bandwidth_hz
        Low-pass of the signals: below the second mode, above the speed of a move.
    memory_s
        Seconds of motion that are remembered: so soon a change of payload is known.
    detected_kg
        Standard deviation from which a payload counts as detected.
    rate_hz
        Sampling rate of the signals.
    """

    cantilever_n_per_m: float = field(
        default=23.72,
        metadata=limits(0.1, 1e5, "N/m", "stiffness 3 EI / L^3 of the arm as a cantilever"),
    )
    tare_kg: float = field(
        default=0.142,
        metadata=limits(0.001, 10.0, "kg", "what an arm without payload weighs at its tip"),
    )
    strain_per_speed_s2: float = field(
        default=184.5,
        metadata=limits(-1e5, 1e5, "1/s^2", "K: base gauge over tachometer of the cantilever"),
    )
    bandwidth_hz: float = field(
        default=2.0, metadata=limits(0.2, 10.0, "Hz", "low-pass of the signals")
    )
    memory_s: float = field(
        default=3.0, metadata=limits(0.5, 60.0, "s", "motion that is remembered")
    )
    detected_kg: float = field(
        default=0.08,
        metadata=limits(0.001, 1.0, "kg", "deviation from which a payload counts as detected"),
    )
    rate_hz: float = field(
        default=300.0, metadata=limits(50.0, 2000.0, "Hz", "sampling rate of the signals")
    )


class PayloadEstimate(NamedTuple):
    """The payload as far as the motion has told it.

    Attributes
    ----------
    payload_kg
        Estimate, 0 to `MAX_PAYLOAD_KG`.
    deviation_kg
        Its standard deviation; infinite before the arm has moved.
    detected
        Whether the deviation is small enough to choose gains by.
    """

    payload_kg: float
    deviation_kg: float
    detected: bool


NO_ESTIMATE = PayloadEstimate(0.0, math.inf, detected=False)


class PayloadEstimator:
    """Listens to the samples and weighs the payload.

    Parameters
    ----------
    detection
        What is known of the rig.
    """

    def __init__(self, detection: PayloadDetection) -> None:
        dt_s = 1.0 / detection.rate_hz
        self._detection = detection
        self._a, self._b = _filters(detection, dt_s)
        self._keep = 1.0 - min(1.0, dt_s / detection.memory_s)
        # Filtered residuals repeat themselves over the memory of the filter.
        self._alike = max(1.0, 1.0 / (2.0 * math.pi * detection.bandwidth_hz * dt_s))
        self._next = np.zeros(len(self._a))
        self._input = np.zeros(2)
        self.reset()

    def reset(self) -> None:
        """Forget the past, as for an arm at rest."""
        self._state = np.zeros(len(self._a))
        self._zv, self._zw, self._zz = np.zeros((3, len(_INSTRUMENT_PAYLOADS_KG)))
        self._vv = self._vw = self._ww = self._count = 0.0

    def step(self, volts: Sequence[float]) -> None:
        """Take one sample in; what cannot be a measurement is left out.

        Parameters
        ----------
        volts
            Position, base strain, middle strain and speed, V.
        """
        base_v, speed_v = volts[_BASE_STRAIN], volts[_SPEED]
        if not (abs(base_v) < _PLAUSIBLE_V and abs(speed_v) < _PLAUSIBLE_V):
            return
        self._input[0], self._input[1] = base_v, speed_v
        np.dot(self._a, self._state, out=self._next)
        self._next += self._b @ self._input
        self._state, self._next = self._next, self._state
        v, _, curvature, speed, acceleration = self._state[:5].tolist()
        if abs(speed) < _MOVING_V:
            return
        w = self._detection.strain_per_speed_s2 * acceleration - curvature
        z = self._state[2 * _FILTER_ORDER :: 2]
        keep = self._keep
        self._zv = keep * self._zv + z * v
        self._zw = keep * self._zw + z * w
        self._zz = keep * self._zz + z * z
        self._vv = keep * self._vv + v * v
        self._vw = keep * self._vw + v * w
        self._ww = keep * self._ww + w * w
        self._count = keep * self._count + 1.0

    @property
    def estimate(self) -> PayloadEstimate:
        """The payload by v = a w over the samples in motion, with the best instrument."""
        if self._count < self._alike:
            return NO_ESTIMATE
        detection = self._detection
        with np.errstate(divide="ignore", invalid="ignore"):
            a = np.where(self._zw > 0.0, self._zv / self._zw, np.inf)
        weights_kg = detection.cantilever_n_per_m * a - detection.tare_kg
        best = int(np.argmin(np.abs(weights_kg - _INSTRUMENT_PAYLOADS_KG)))
        if not math.isfinite(a[best]):
            return NO_ESTIMATE
        residual = max(0.0, self._vv - 2.0 * a[best] * self._vw + a[best] ** 2 * self._ww)
        variance = residual / self._count * self._alike * self._zz[best] / self._zw[best] ** 2
        deviation_kg = detection.cantilever_n_per_m * math.sqrt(variance)
        return PayloadEstimate(
            min(max(float(weights_kg[best]), 0.0), MAX_PAYLOAD_KG),
            deviation_kg,
            deviation_kg <= detection.detected_kg,
        )


def _filters(
    detection: PayloadDetection, dt_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Low-pass and derivatives of both signals, and the instrument, from one state to the next.

    The state is base strain, its first and second derivative, the same of the speed, and each
    instrument with its derivative; the inputs are base strain and speed.
    """
    denominator = _butterworth(2.0 * math.pi * detection.bandwidth_hz)
    lowpass = np.diag(np.ones(_FILTER_ORDER - 1), 1)
    lowpass[-1] = -denominator[:0:-1]
    instruments = (detection.tare_kg + _INSTRUMENT_PAYLOADS_KG) / detection.cantilever_n_per_m
    a = np.zeros((2 * _FILTER_ORDER + 2 * len(instruments),) * 2)
    b = np.zeros((len(a), 2))
    for channel in range(2):
        states = slice(channel * _FILTER_ORDER, (channel + 1) * _FILTER_ORDER)
        a[states, states] = lowpass
        b[states.stop - 1, channel] = denominator[-1]
    for number, instrument in enumerate(instruments.tolist()):
        bending = 2 * (_FILTER_ORDER + number)
        a[bending, bending + 1] = 1.0
        a[bending + 1, bending] = -1.0 / instrument
        a[bending + 1, bending + 1] = -2.0 * _INSTRUMENT_DAMPING / math.sqrt(instrument)
        a[bending + 1, _FILTER_ORDER + 1] = detection.strain_per_speed_s2 / instrument
    held = np.zeros((a.shape[0] + b.shape[1],) * 2)
    held[: len(a)] = np.hstack([a, b])
    transition = expm(dt_s * held)[: len(a)]
    return transition[:, : len(a)], transition[:, len(a) :]


def _butterworth(cutoff_rad_s: float) -> NDArray[np.float64]:
    """Denominator of the analog low-pass, highest power first; its gain at rest is one."""
    # scipy.signal would say it in one word and take half a second to load, in every controller.
    angles = np.pi / (2 * _FILTER_ORDER) * np.arange(1 - _FILTER_ORDER, _FILTER_ORDER, 2)
    return np.real(np.poly(-cutoff_rad_s * np.exp(1j * angles)))

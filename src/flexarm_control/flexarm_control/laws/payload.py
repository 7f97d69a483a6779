"""Payload at the tip, estimated from the motion (chapter 5, future work 1).

Seen from the hub the arm is a cantilever with the payload at its end. The base gauge y2 measures
the bending of the cantilever, the tachometer y4 the rotation of its root::

    a d2(y2)/dt2 + y2 = a K d(y4)/dt,    a = m L^3 / (3 EI)

`a` is the tip mass over the stiffness of the cantilever, so it is affine in the payload. `K` holds
only the stiffness and the gains of the two sensors. Neither motor nor friction enters.

A Butterworth low-pass filters the equation as a state variable filter [1]_, which gives the
derivatives. The equation is solved for `a` by instrumental variables [2]_. The instrument is the
bending of a cantilever of known payload that the same speed drives. It has no noise of the gauge,
so that noise does not bias the estimate. The estimate uses the instrument whose payload is closest
to it, as in the refined method of [1]_. Only samples in motion count.

References
----------
.. [1] Young, P. (1981). Parameter estimation for continuous-time models: a survey. Automatica
   17(1), 23-39.
.. [2] Soderstrom, T., and Stoica, P. (1983). Instrumental Variable Methods for System
   Identification. Springer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import sub
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_control.laws.law_protocol import Memory

MAX_PAYLOAD_KG = 1.0
"""Heaviest payload that an estimate may name."""

_FILTER_ORDER = 3
_INSTRUMENT_PAYLOADS_KG = np.array([0.0, 0.1, 0.2, 0.3, 0.45, 0.7, 1.0])
_INSTRUMENT_DAMPING = 0.05
_BASE_STRAIN, _SPEED = 1, 3
_PLAUSIBLE_V = 100.0
"""Ten times the range of the converter; a larger reading, or NaN, is not a measurement."""
_MOVING_V = 0.01
"""Speed signal after the low-pass that counts as motion: a few times the tachometer noise."""


@dataclass(frozen=True)
class PayloadSensing(Bounded):
    """Settings of the payload estimator, without the rate of its signals.

    The default stiffness 3 EI / L^3 is that of section 2.3. The tare is the share of the arm
    itself, the holder and the higher modes. A move without payload measures it: the estimate plus
    the tare in force. The coefficient K is (L - x) 3 EI / L^2 times the gains of the sensors. The
    low-pass lies below the second mode and above the speed of a move. A change of payload is known
    after `memory_s`.
    """

    cantilever_n_per_m: float = setting(23.72, 0.1, 1e5, "N/m", "stiffness of the arm, 3 EI / L^3")
    tare_kg: float = setting(0.142, 0.001, 10.0, "kg", "tip mass of an arm without payload")
    strain_per_speed_s2: float = setting(184.5, -1e5, 1e5, "1/s^2", "K: base gauge over tachometer")
    bandwidth_hz: float = setting(2.0, 0.2, 10.0, "Hz", "low-pass of the signals")
    memory_s: float = setting(3.0, 0.5, 60.0, "s", "motion that is remembered")
    detected_kg: float = setting(0.08, 0.001, 1.0, "kg", "largest deviation of a detected payload")


@dataclass(frozen=True)
class PayloadDetection(PayloadSensing):
    """Settings of the payload estimator."""

    rate_hz: float = setting(300.0, 50.0, 2000.0, "Hz", "sampling rate of the signals")


class PayloadEstimate(NamedTuple):
    """Estimate of the payload.

    Attributes
    ----------
    payload_kg : float
        Estimate, 0 to `MAX_PAYLOAD_KG`, kg.
    deviation_kg : float
        Standard deviation, kg; infinite before the arm has moved.
    detected : bool
        True if the deviation is small enough to choose gains.
    """

    payload_kg: float
    deviation_kg: float
    detected: bool


NO_ESTIMATE = PayloadEstimate(0.0, math.inf, detected=False)


class PayloadEstimator:
    """Estimator of the payload from the samples.

    Parameters
    ----------
    detection : PayloadDetection
        Settings of the estimator and of the rig.
    """

    def __init__(self, detection: PayloadDetection) -> None:
        dt_s = 1.0 / detection.rate_hz
        self._detection = detection
        self._a, self._b = _filters(detection, dt_s)
        self._keep = 1.0 - min(1.0, dt_s / detection.memory_s)
        # Filtered residuals are correlated over the memory of the filter.
        self._alike = max(1.0, 1.0 / (2.0 * math.pi * detection.bandwidth_hz * dt_s))
        self._next, self._driven = np.zeros((2, len(self._a)))
        self._input = np.zeros(2)
        self._factors = np.zeros((3, len(_INSTRUMENT_PAYLOADS_KG)))
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._state = np.zeros(len(self._a))
        # Of each instrument z: z v, z w, z z.
        self._z_sums = np.zeros((3, len(_INSTRUMENT_PAYLOADS_KG)))
        self._vv = self._vw = self._ww = self._count = 0.0

    def memory(self) -> Memory:
        """Return filters and sums; see `flexarm_control.laws.law_protocol.LawWithMemory.memory`."""
        zv, zw, zz = self._z_sums.tolist()
        return {
            "filters": self._state.tolist(),
            "zv": zv,
            "zw": zw,
            "zz": zz,
            "sums": (self._vv, self._vw, self._ww, self._count),
        }

    def remember(self, memory: Memory) -> None:
        """Go on from filters and sums, as a law does."""
        self._state = np.array(memory["filters"])
        self._z_sums = np.array([memory[name] for name in ("zv", "zw", "zz")])
        self._vv, self._vw, self._ww, self._count = memory["sums"]

    def step(self, volts: Sequence[float]) -> None:
        """Take one sample (position, base strain, middle strain, speed, V), if it is plausible."""
        base_v, speed_v = volts[_BASE_STRAIN], volts[_SPEED]
        if not (abs(base_v) < _PLAUSIBLE_V and abs(speed_v) < _PLAUSIBLE_V):
            return
        self._input[0], self._input[1] = base_v, speed_v
        np.dot(self._a, self._state, out=self._next)
        np.dot(self._b, self._input, out=self._driven)
        self._next += self._driven
        self._state, self._next = self._next, self._state
        v, _, curvature, speed, acceleration = self._state[:5].tolist()
        if abs(speed) < _MOVING_V:
            return
        w = self._detection.strain_per_speed_s2 * acceleration - curvature
        z = self._state[2 * _FILTER_ORDER :: 2]
        keep = self._keep
        self._factors[0], self._factors[1], self._factors[2] = v, w, z
        self._z_sums *= keep
        self._z_sums += self._factors * z
        self._vv = keep * self._vv + v * v
        self._vw = keep * self._vw + v * w
        self._ww = keep * self._ww + w * w
        self._count = keep * self._count + 1.0

    @property
    def estimate(self) -> PayloadEstimate:
        """Payload by v = a w over the samples in motion, with the best instrument."""
        if self._count < self._alike:
            return NO_ESTIMATE
        detection = self._detection
        # Of a few numbers, lists are faster than arrays.
        ratios = [v / w if w > 0.0 else math.inf for v, w in self._z_sums[:2].T.tolist()]
        weights_kg = [detection.cantilever_n_per_m * each - detection.tare_kg for each in ratios]
        misses_kg = list(map(abs, map(sub, weights_kg, _INSTRUMENT_PAYLOADS_KG.tolist())))
        best = misses_kg.index(min(misses_kg))
        if not math.isfinite(ratios[best]):
            return NO_ESTIMATE
        # Numbers of NumPy: a square beyond all floats is infinite, not an error.
        a = np.float64(ratios[best])
        _, zw, zz = self._z_sums[:, best]
        residual = max(0.0, self._vv - 2.0 * a * self._vw + a**2 * self._ww)
        variance = residual / self._count * self._alike * zz / zw**2
        deviation_kg = detection.cantilever_n_per_m * math.sqrt(variance)
        return PayloadEstimate(
            min(max(weights_kg[best], 0.0), MAX_PAYLOAD_KG),
            deviation_kg,
            deviation_kg <= detection.detected_kg,
        )


def _filters(
    detection: PayloadDetection, dt_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the transition of low-passes, derivatives and instruments from one sample to the next.

    The state is base strain, its first and second derivative, the same of the speed, and each
    instrument with its derivative. The inputs are base strain and speed.
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
    transition = scipy.linalg.expm(dt_s * held)[: len(a)]
    return transition[:, : len(a)], transition[:, len(a) :]


def _butterworth(cutoff_rad_s: float) -> NDArray[np.float64]:
    """Return the denominator of the low-pass, highest power first; its gain at rest is 1."""
    # scipy.signal has this function, but takes half a second to load in every controller.
    angles = np.pi / (2 * _FILTER_ORDER) * np.arange(1 - _FILTER_ORDER, _FILTER_ORDER, 2)
    return np.real(np.poly(-cutoff_rad_s * np.exp(1j * angles)))

"""Sensor check: comparison of every sample with the limits of a healthy rig.

- **Not a number**: the reading is NaN or infinite.
- **Out of its travel**: the stops hold the arm, so such a position is that of an open
  potentiometer.
- **Saturated**: speed and gauges stay at the end of the input range for longer than the arm can
  keep them there.
- **Stuck**: the same code repeats although every channel has noise.
- **Disagreement**: position and integrated speed drift apart, so one of the two is wrong.

The limits leave room for the hardest motion of the simulated rig. Full current against the stops
with 400 g saturates the base gauge for 0.35 s. Full current reversed at a resonance lets position
and speed disagree by 15 degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final

from flexarm_core.channels import CHANNEL_NAMES, CHANNELS, INPUT_RANGE_V
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Collection

    import numpy as np
    from numpy.typing import NDArray

SATURATED_V: Final = 0.999 * INPUT_RANGE_V
"""A reading of this magnitude is at the end of the input range."""

MIN_AGREEMENT_HZ: Final = 100.0
"""Below this rate the speed cannot be integrated: it changes too much from sample to sample."""

_MAX_GAP_PERIODS: Final = 3.0
_POSITION, _, _, _SPEED = CHANNELS


@dataclass(frozen=True)
class SensorLimits:
    """Limits of a healthy rig.

    Attributes
    ----------
    stuck_samples : int
        Equal readings in a row that mean a stuck sensor; 0 for a rig without noise. With noise of
        one converter step, 30 of them come by chance once in 10^15 samples.
    max_position_v : float
        Position that the arm cannot reach, V; the stops give way to 7.2 V at most.
    travel_samples : int
        Readings beyond it in a row that are no disturbance.
    speed_saturated_s, gauge_saturated_s : float
        Time at the end of the range that means a broken sensor, s.
    disagreement_rad : float
        Largest difference of position and integrated speed, rad.
    memory_s : float
        Time over which the difference is forgotten, s, so that an offset of the tachometer does not
        add up.

    Raises
    ------
    SettingError
        If a limit is negative or not a number, or one other than `stuck_samples` is zero.
    """

    stuck_samples: int = 30
    max_position_v: float = 7.5
    travel_samples: int = 3
    speed_saturated_s: float = 0.1
    gauge_saturated_s: float = 0.5
    disagreement_rad: float = math.radians(25.0)
    memory_s: float = 0.5

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            may_be_zero = field.name == "stuck_samples"
            if not (0.0 < value < math.inf or (may_be_zero and value == 0)):
                raise SettingError(f"{field.name} must be a positive number, got {value}")


class SensorCheck:
    """Examination of every sample of one run.

    Parameters
    ----------
    rate_hz : float
        Sampling rate, Hz.
    limits : SensorLimits, optional
        Limits of a healthy rig.
    absent : collection of str
        Channels without a sensor: their readings need only be numbers.
    """

    def __init__(
        self,
        rate_hz: float,
        limits: SensorLimits | None = None,
        absent: Collection[str] = (),
    ) -> None:
        self.limits = limits if limits is not None else SensorLimits()
        speed_samples = math.ceil(self.limits.speed_saturated_s * rate_hz)
        gauge_samples = math.ceil(self.limits.gauge_saturated_s * rate_hz)
        self._saturated_samples = (
            self.limits.travel_samples,
            gauge_samples,
            gauge_samples,
            speed_samples,
        )
        self._max_gap_s = _MAX_GAP_PERIODS / rate_hz
        self._absent = frozenset(absent)
        can_compare = self._absent.isdisjoint((_POSITION.name, _SPEED.name))
        self._can_integrate = can_compare and rate_hz >= MIN_AGREEMENT_HZ
        self._last_s = -math.inf
        self._last = [math.nan] * len(CHANNELS)
        self._equal = [0] * len(CHANNELS)
        self._saturated = [0] * len(CHANNELS)
        self._drift_rad = 0.0

    def complaint(self, time_s: float, volts: NDArray[np.float64]) -> str:
        """Examine the next sample and return its fault in one line; empty if there is none.

        Parameters
        ----------
        time_s : float
            Instant of the sample, s.
        volts : ndarray, (4,)
            Readings, V.
        """
        readings = volts.tolist()
        found = ""
        for channel, reading in enumerate(readings):
            found = found or self._of_channel(channel, reading)
        found = found or self._of_agreement(time_s, readings)
        self._last_s, self._last = time_s, readings
        return found

    def _of_channel(self, channel: int, reading: float) -> str:
        name = CHANNEL_NAMES[channel]
        if not math.isfinite(reading):
            return f"{name} is not a number"
        if name in self._absent:
            return ""
        limit_v = self.limits.max_position_v if channel == 0 else SATURATED_V
        self._saturated[channel] = self._saturated[channel] + 1 if abs(reading) >= limit_v else 0
        if self._saturated[channel] >= self._saturated_samples[channel]:
            where = "beyond the stops" if channel == 0 else "at the end of its range"
            return f"{name} is {where} at {reading:.3f} V: saturated or open"
        is_equal = reading == self._last[channel] and abs(reading) < SATURATED_V
        self._equal[channel] = self._equal[channel] + 1 if is_equal else 1
        if 0 < self.limits.stuck_samples <= self._equal[channel]:
            equal = f"{self._equal[channel]} equal readings"
            return f"{name} is stuck at {reading:.3f} V: {equal}, as stuck_samples has it"
        return ""

    def _of_agreement(self, time_s: float, readings: list[float]) -> str:
        interval_s = time_s - self._last_s
        speeds_v = (self._last[-1], readings[-1])
        can_tell = (
            self._can_integrate
            and interval_s <= self._max_gap_s
            and all(abs(speed_v) < SATURATED_V for speed_v in speeds_v)
        )
        if not can_tell:
            self._drift_rad = 0.0
            return ""
        turned_rad = _POSITION.to_si(readings[0] - self._last[0])
        self._drift_rad *= 1.0 - min(1.0, interval_s / self.limits.memory_s)
        self._drift_rad += turned_rad - interval_s * _SPEED.to_si(sum(speeds_v) / 2.0)
        if abs(self._drift_rad) <= self.limits.disagreement_rad:
            return ""
        return (
            f"position_v and speed_v disagree by {math.degrees(abs(self._drift_rad)):.0f} degrees: "
            "one of the two is wrong"
        )

"""Sensor check: comparison of every sample with the limits of a healthy rig.

- **Not a number**: the reading is NaN or infinite.
- **Out of its travel**: the stops hold the arm, so such a position is that of an open
  potentiometer.
- **Saturated**: a reading stays at the end of its range for longer than the arm can keep it there.
- **Stuck**: the same code repeats although every channel has noise.
- **Disagreement**: position and integrated speed of a joint drift apart, so one of the two is
  wrong.

The limits of the thesis's arm leave room for the hardest motion of the simulated rig. Full current
against the stops with 400 g saturates the base gauge for 0.35 s. Full current reversed at a
resonance lets position and speed disagree by 15 degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final, NamedTuple

from flexarm_core.channels import INPUT_RANGE_V
from flexarm_core.errors import SettingError
from flexarm_core.rig_description import load_rig

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    import numpy as np
    from numpy.typing import NDArray

    from flexarm_core.rig_description import Output, RigDescription

SATURATED: Final = 0.999
"""A reading at this part of its range is at its end."""

SATURATED_V: Final = SATURATED * INPUT_RANGE_V
"""A reading of the thesis's arm of this magnitude is at the end of the input range."""

STOPS_GIVE: Final = 0.05
"""Beyond each end of its travel a joint of another rig may turn by this part of it."""

MIN_AGREEMENT_HZ: Final = 100.0
"""Below this rate the speed cannot be integrated: it changes too much from sample to sample."""

_MAX_GAP_PERIODS: Final = 3.0


@dataclass(frozen=True)
class SensorLimits:
    """Limits of a healthy rig; those in volts are the thesis's arm's.

    Attributes
    ----------
    stuck_samples : int
        Equal readings in a row that mean a stuck sensor; 0 for a rig without noise. With noise of
        one converter step, 30 of them come by chance once in 10^15 samples.
    max_position_v : float
        Position that the arm cannot reach, V; the stops give way to 7.2 V at most.
    travel_samples : int
        Readings beyond it in a row that are not a disturbance.
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


class _Range(NamedTuple):
    """Range of an output's readings, and for how many samples it may be left."""

    name: str
    unit: str
    low: float
    high: float
    samples: int
    end: str
    saturated_low: float
    saturated_high: float


class _Pair(NamedTuple):
    """Angle and rate of a joint: places among the outputs, and their conversion to SI."""

    angle: int
    rate: int
    angle_to_si: Callable[[float], float]
    rate_to_si: Callable[[float], float]
    text: str


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
    rig : RigDescription, optional
        Rig with its outputs, their ranges and joints; by default the thesis's arm, whose limits in
        volts are those of `limits`.

    Attributes
    ----------
    outputs : int
        Number of readings of a sample.
    """

    def __init__(
        self,
        rate_hz: float,
        limits: SensorLimits | None = None,
        absent: Collection[str] = (),
        rig: RigDescription | None = None,
    ) -> None:
        self.limits = limits if limits is not None else SensorLimits()
        self._absent = frozenset(absent)
        if rig is None:
            self._ranges = tuple(self._of_thesis(rate_hz))
        else:
            self._absent |= {each.name for each in rig.outputs if each.absent}
            self._ranges = tuple(self._of_rig(rate_hz, rig))
        self.outputs = len(self._ranges)
        self._max_gap_s = _MAX_GAP_PERIODS / rate_hz
        can_integrate = rate_hz >= MIN_AGREEMENT_HZ
        self._pairs = tuple(self._joints(rig or load_rig("thesis"))) if can_integrate else ()
        self._last_s = -math.inf
        self._last = [math.nan] * self.outputs
        self._equal = [0] * self.outputs
        self._saturated = [0] * self.outputs
        self._drift_rad = [0.0] * len(self._pairs)

    def _of_thesis(self, rate_hz: float) -> Iterator[_Range]:
        """Yield the ranges of the thesis's arm, with its own times at their ends."""
        gauge_samples = math.ceil(self.limits.gauge_saturated_s * rate_hz)
        rig = load_rig("thesis")
        (hub,) = rig.joints
        samples = {
            hub.angle: self.limits.travel_samples,
            hub.rate: math.ceil(self.limits.speed_saturated_s * rate_hz),
        }
        for output in rig.outputs:
            is_position = output.name == hub.angle
            high = self.limits.max_position_v if is_position else SATURATED_V
            yield _range(output, -high, high, samples.get(output.name, gauge_samples), is_position)

    def _of_rig(self, rate_hz: float, rig: RigDescription) -> Iterator[_Range]:
        """Yield the ranges of any rig by its description."""
        joints = {each.angle: each for each in rig.joints}
        held_samples = math.ceil(self.limits.gauge_saturated_s * rate_hz)
        for output in rig.outputs:
            if output.name in joints:
                joint = joints[output.name]
                give = STOPS_GIVE * (joint.high - joint.low)
                low, high = joint.low - give, joint.high + give
                yield _range(output, low, high, self.limits.travel_samples, is_position=True)
                continue
            yield _range(output, *_saturated(output), held_samples, is_position=False)

    def _joints(self, rig: RigDescription) -> Iterator[_Pair]:
        for joint in rig.joints:
            if joint.rate is None or not self._absent.isdisjoint((joint.angle, joint.rate)):
                continue
            angle, rate = rig.output(joint.angle), rig.output(joint.rate)
            if (angle.quantity, rate.quantity) != ("angle", "rate"):
                continue
            names = rig.output_names
            yield _Pair(
                names.index(joint.angle),
                names.index(joint.rate),
                angle.to_si,
                rate.to_si,
                f"{joint.angle} and {joint.rate}",
            )

    def complaint(self, time_s: float, outputs: NDArray[np.float64]) -> str:
        """Examine the next sample and return its fault in one line; empty if there is none.

        Parameters
        ----------
        time_s : float
            Instant of the sample, s.
        outputs : ndarray, (outputs,)
            Readings.
        """
        readings = outputs.tolist()
        found = ""
        for channel, reading in enumerate(readings):
            found = found or self._of_channel(channel, reading)
        interval_s = time_s - self._last_s
        for number, pair in enumerate(self._pairs):
            found = found or self._of_agreement(number, pair, interval_s, readings)
        self._last_s, self._last = time_s, readings
        return found

    def _of_channel(self, channel: int, reading: float) -> str:
        within = self._ranges[channel]
        name = within.name
        if not math.isfinite(reading):
            return f"{name} is not a number"
        if name in self._absent:
            return ""
        is_beyond = not within.low < reading < within.high
        self._saturated[channel] = self._saturated[channel] + 1 if is_beyond else 0
        if self._saturated[channel] >= within.samples:
            return f"{name} is {within.end} at {reading:.3f} {within.unit}: saturated or open"
        is_equal = (
            reading == self._last[channel]
            and within.saturated_low < reading < within.saturated_high
        )
        self._equal[channel] = self._equal[channel] + 1 if is_equal else 1
        if 0 < self.limits.stuck_samples <= self._equal[channel]:
            equal = f"{self._equal[channel]} equal readings"
            at = f"{reading:.3f} {within.unit}"
            return f"{name} is stuck at {at}: {equal}, as stuck_samples has it"
        return ""

    def _of_agreement(
        self, number: int, pair: _Pair, interval_s: float, readings: list[float]
    ) -> str:
        rates = (self._last[pair.rate], readings[pair.rate])
        ends = self._ranges[pair.rate]
        is_comparable = interval_s <= self._max_gap_s and all(
            ends.saturated_low < rate < ends.saturated_high for rate in rates
        )
        if not is_comparable:
            self._drift_rad[number] = 0.0
            return ""
        turned_rad = pair.angle_to_si(readings[pair.angle] - self._last[pair.angle])
        drift_rad = self._drift_rad[number]
        drift_rad *= 1.0 - min(1.0, interval_s / self.limits.memory_s)
        drift_rad += turned_rad - interval_s * pair.rate_to_si(sum(rates) / 2.0)
        self._drift_rad[number] = drift_rad
        if abs(drift_rad) <= self.limits.disagreement_rad:
            return ""
        return (
            f"{pair.text} disagree by {math.degrees(abs(drift_rad)):.0f} degrees: "
            "one of the two is wrong"
        )


def _range(output: Output, low: float, high: float, samples: int, is_position: bool) -> _Range:  # noqa: FBT001
    """Return the range of an output; readings at its physical end repeat without being stuck."""
    return _Range(
        *(output.name, output.unit, low, high, samples),
        "beyond the stops" if is_position else "at the end of its range",
        *_saturated(output),
    )


def _saturated(output: Output) -> tuple[float, float]:
    """Return the readings at and beyond which an output is at an end of its range."""
    edge = (1.0 - SATURATED) * 0.5 * output.span
    return (output.low + edge, output.high - edge) if edge else (-math.inf, math.inf)

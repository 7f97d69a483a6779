"""Rig or sensor with one fault that sets in at a known sample, for tests of the loop."""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING, Final

import numpy as np

from flexarm_core.channels import CHANNEL_NAMES, INPUT_RANGE_V
from flexarm_core.errors import SettingError
from flexarm_daq.rigs.rig_protocol import RigError, RigSample

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_daq.rigs.rig_protocol import Rig

_BURST_SAMPLES: Final = 30
_BURST_V: Final = 1.0
_OPEN_DECAY: Final = 0.7


class Fault(Enum):
    """Fault of a rig."""

    STUCK = "stuck"
    """The sensor keeps its reading."""
    OPEN = "open"
    """The wire is broken: the input floats to the end of its range."""
    SATURATED = "saturated"
    """The reading jumps to the lower end of its range."""
    NOT_A_NUMBER = "not_a_number"
    """The reading is NaN."""
    NOISE_BURST = "noise_burst"
    """The sensor has noise of 1 V for 30 samples and then recovers."""
    SHORT_READ = "short_read"
    """The converter gives three readings instead of four."""
    FROZEN_TIME = "frozen_time"
    """The converter's clock stands still."""
    READ_ERROR = "read_error"
    """Reading raises a `RigError`."""
    WRITE_ERROR = "write_error"
    """Writing a command raises a `RigError`; the zero of `safe_stop` still passes."""
    EXCEPTION = "exception"
    """Reading raises an unexpected error."""


SENSOR_FAULTS: Final = (
    Fault.STUCK,
    Fault.OPEN,
    Fault.SATURATED,
    Fault.NOT_A_NUMBER,
    Fault.NOISE_BURST,
)
"""Faults of one channel."""


class FaultySensor:
    """One of the four sensors, with a fault.

    Parameters
    ----------
    fault : Fault
        One of `SENSOR_FAULTS`.
    channel : str
        Sensor.
    after_samples : int
        Number of good samples; also the seed of the noise of a burst.

    Raises
    ------
    SettingError
        If there is no such channel or the number of samples is negative.
    """

    def __init__(self, fault: Fault, channel: str, after_samples: int) -> None:
        if channel not in CHANNEL_NAMES:
            raise SettingError(f"channel must be one of {', '.join(CHANNEL_NAMES)}, got {channel}")
        if after_samples < 0:
            raise SettingError(f"after_samples must not be negative, got {after_samples}")
        self._fault = fault
        self._channel = CHANNEL_NAMES.index(channel)
        self._after_samples = after_samples
        self.reset()

    def reset(self) -> None:
        """Begin again, in good health."""
        self._samples = 0
        self._last_v = 0.0
        self._random = np.random.default_rng(self._after_samples)

    def spoiled(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the four readings of the next sample, V, with the fault once it has set in."""
        self._samples += 1
        spoiled_v = volts.copy()
        if self._samples > self._after_samples:
            spoiled_v[self._channel] = self._reading(float(volts[self._channel]))
        self._last_v = float(spoiled_v[self._channel])
        return spoiled_v

    def _reading(self, healthy_v: float) -> float:
        if self._fault is Fault.STUCK:
            return self._last_v
        if self._fault is Fault.OPEN:
            return INPUT_RANGE_V - _OPEN_DECAY * (INPUT_RANGE_V - self._last_v)
        if self._fault is Fault.SATURATED:
            return -INPUT_RANGE_V
        if self._fault is Fault.NOT_A_NUMBER:
            return math.nan
        is_over = self._samples > self._after_samples + _BURST_SAMPLES
        return healthy_v + (0.0 if is_over else _BURST_V * self._random.standard_normal())


class FaultyRig:
    """A `flexarm_daq.rigs.rig_protocol.Rig` around another one, with a fault.

    Parameters
    ----------
    rig : Rig
        Rig without the fault.
    fault : Fault
        Fault to inject.
    after_samples : int
        Number of good samples, counted from opening.
    channel : str
        Sensor of a sensor fault.

    Raises
    ------
    SettingError
        If there is no such channel or the number of samples is negative.
    """

    def __init__(
        self, rig: Rig, fault: Fault, *, after_samples: int, channel: str = CHANNEL_NAMES[0]
    ) -> None:
        self._rig = rig
        self._fault = fault
        self._after_samples = after_samples
        self._sensor = FaultySensor(fault, channel, after_samples)

    def open(self) -> None:
        """Open the rig, in good health."""
        self._rig.open()
        self._samples = 0
        self._last_s = 0.0
        self._sensor.reset()

    def read(self) -> RigSample:
        """Sample the rig through the fault; see `Rig.read`.

        Raises
        ------
        ArithmeticError
            If the fault is the unexpected exception.
        """
        sample = self._rig.read()
        self._samples += 1
        if self._fault in SENSOR_FAULTS:
            return RigSample(sample.time_s, self._sensor.spoiled(sample.outputs))
        if self._is_broken():
            sample = self._spoiled(sample)
        self._last_s = sample.time_s
        return sample

    def write(self, commands: Sequence[float]) -> None:
        """Command the drive; see `Rig.write`."""
        if self._is_broken() and self._fault is Fault.WRITE_ERROR:
            raise RigError("injected: the command could not be written")
        self._rig.write(commands)

    def safe_stop(self) -> None:
        """Set the drive to zero."""
        self._rig.safe_stop()

    def close(self) -> None:
        """Close the rig."""
        self._rig.close()

    def _is_broken(self) -> bool:
        return self._samples > self._after_samples

    def _spoiled(self, sample: RigSample) -> RigSample:
        if self._fault is Fault.SHORT_READ:
            return RigSample(sample.time_s, sample.outputs[:-1])
        if self._fault is Fault.FROZEN_TIME:
            return RigSample(self._last_s, sample.outputs)
        if self._fault is Fault.READ_ERROR:
            raise RigError("injected: the reading failed")
        if self._fault is Fault.EXCEPTION:
            raise ArithmeticError("injected: a defect of the driver")
        return sample

"""Reading of a rig at rest: each channel's level, noise and rate, with nothing driven."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.bounds import shown
from flexarm_core.errors import with_place
from flexarm_daq.rigs.rig_protocol import OFF_RATE, RigError, has_own_clock, has_virtual_time

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_core.rig_description import Output, RigDescription
    from flexarm_daq.rigs.rig_protocol import Rig, RigSample


@dataclass(frozen=True, eq=False)
class RestReading:
    """Readings of a rig at rest.

    Attributes
    ----------
    raw : ndarray, (samples, outputs)
        Readings of the driver.
    rate_hz : float
        Measured sampling rate, Hz.
    about : str
        What the driver says of its hardware, in its attribute `about`.
    """

    raw: FloatArray
    rate_hz: float
    about: str

    def values(self, channel: int, output: Output) -> FloatArray:
        """Return the values of one output, (samples,), in its unit."""
        return np.array([output.value(raw) for raw in self.raw[:, channel]])

    def require_rate(self, rate_hz: float, remedy: str) -> None:
        """Refuse another rate than that of the description.

        Raises
        ------
        RigError
            If it is off by more than `OFF_RATE`.
        """
        if abs(self.rate_hz / rate_hz - 1.0) > OFF_RATE:
            raise RigError(
                f"the rig samples at {self.rate_hz:.5g} Hz, and rate_hz is {rate_hz:g}: {remedy}"
            )


def read_at_rest(rig: Rig, description: RigDescription, duration_s: float) -> RestReading:
    """Open a rig, read it for a while and close it; nothing is written but the driver's own zero.

    Raises
    ------
    RigError
        If it cannot be opened or read, or has another number of readings than outputs.
    """
    rig.open()
    try:
        return readings_of(rig, description, duration_s)
    finally:
        rig.safe_stop()
        rig.close()


def _read(rig: Rig) -> RigSample:
    """Return the next sample; an error of a driver of one's own names the line that raised it."""
    try:
        sample = rig.read()
    except RigError:
        raise
    except Exception as error:
        raise RigError(f"read() of the driver failed: {with_place(error)}") from error
    if not hasattr(sample, "outputs"):
        raise RigError(
            f"read() of the driver returned {shown(sample)}: it must return a "
            "RigSample(time_s, outputs)"
        )
    return sample


def readings_of(rig: Rig, description: RigDescription, duration_s: float) -> RestReading:
    """Read an open rig for a while.

    Raises
    ------
    RigError
        If it cannot be read, or has another number of readings than outputs.
    """
    samples = max(2, round(duration_s * description.rate_hz))
    paced = not (has_own_clock(rig) or has_virtual_time(rig))
    raw = np.empty((samples, len(description.outputs)))
    times_s, begins_s, ends_s = np.empty((3, samples))
    begun_s = time.monotonic()
    for k in range(samples):
        if paced:
            time.sleep(max(0.0, begun_s + k / description.rate_hz - time.monotonic()))
        begins_s[k] = time.monotonic()
        sample = _read(rig)
        ends_s[k] = time.monotonic()
        if np.shape(sample.outputs) != raw[k].shape:
            raise RigError(
                f"the driver reads {np.size(sample.outputs)} channels, and rig {description.name} "
                f"has {len(description.outputs)} outputs: {', '.join(description.output_names)}"
            )
        raw[k], times_s[k] = sample.outputs, sample.time_s
    # A busy machine misses samples of a board's clock: most steps are whole.
    period_s = float(np.median(np.diff(times_s)))
    if paced:
        # It is late with its own, which shows nothing of the rig: only a reading that takes longer
        # than a period does, and a clock of the rig that goes at another pace.
        far = samples // 2
        pace = (times_s[far:] - times_s[:-far]) / (begins_s[far:] - begins_s[:-far])
        takes_s = float(np.median(ends_s - begins_s))
        period_s = max(1.0 / description.rate_hz, takes_s) * float(np.median(pace))
    if not period_s > 0.0:
        raise RigError("the rig's clock stands still: its samples need their times, time_s")
    return RestReading(raw, 1.0 / period_s, str(getattr(rig, "about", "")))

"""Rig in the units of its description: raw readings are scaled, turns of encoders are counted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_daq.rigs.rig_protocol import (
    RigError,
    RigSample,
    absent_channels,
    bodies_of,
    has_own_clock,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.rig_description import RigDescription
    from flexarm_daq.rigs.rig_protocol import Rig


class ScaledRig:
    """A `flexarm_daq.rigs.rig_protocol.Rig` around a driver, with values for raw readings.

    An output has the value ``scale * (raw - offset)``. One with a `wrap` is taken to have moved by
    less than half of that from sample to sample, and its turns are counted. A command is written
    with `raw_per_unit`.

    Parameters
    ----------
    driver : Rig
        Driver with raw readings and commands.
    rig : RigDescription
        Its description.
    """

    def __init__(self, driver: Rig, rig: RigDescription) -> None:
        self.driver = driver
        self.has_own_clock = has_own_clock(driver)
        self.bodies = bodies_of(driver)
        absent = [each.name for each in rig.outputs if each.absent]
        self.absent_channels = tuple(dict.fromkeys((*absent, *absent_channels(driver))))
        self._scales = np.array([each.scale for each in rig.outputs])
        self._offsets = np.array([each.offset for each in rig.outputs])
        wraps = np.array([each.wrap or 0.0 for each in rig.outputs])
        self._wrapped = np.flatnonzero(wraps)
        self._wraps = wraps[self._wrapped]
        self._factors = [each.raw_per_unit for each in rig.inputs]
        self._names = rig.output_names
        self._last = np.full(len(self._wrapped), np.nan)
        self._turns = np.zeros(len(self._wrapped))

    def open(self) -> None:
        """Open the driver; turns are counted from here."""
        self._last[:] = np.nan
        self._turns[:] = 0.0
        self.driver.open()

    def read(self) -> RigSample:
        """Return the values of the next sample; see `Rig.read`."""
        sample = self.driver.read()
        raw = np.asarray(sample.outputs, dtype=np.float64)
        if raw.shape != self._scales.shape:
            raise RigError(
                f"the driver reads {raw.size} channels, and the rig has {len(self._names)} "
                f"outputs: {', '.join(self._names)}"
            )
        values = self._scales * (raw - self._offsets)
        if len(self._wrapped):
            values[self._wrapped] = self._unwrapped(values[self._wrapped])
        return RigSample(sample.time_s, values, self._commands(sample.commands))

    def _commands(self, raw: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if raw is None:
            return None
        return tuple(each / factor for each, factor in zip(raw, self._factors, strict=True))

    def _unwrapped(self, values: np.ndarray) -> np.ndarray:
        turned = np.rint((values - self._last) / self._wraps)
        # A reading that is not a number shows no turn, and takes none of those before.
        self._turns -= np.where(np.isfinite(turned), turned, 0.0)
        self._last = np.where(np.isfinite(values), values, self._last)
        return np.asarray(values + self._wraps * self._turns)

    def write(self, commands: Sequence[float]) -> None:
        """Write commands in the driver's own unit; see `Rig.write`."""
        self.driver.write(
            [each * factor for each, factor in zip(commands, self._factors, strict=True)]
        )

    def safe_stop(self) -> None:
        """Set the drives to zero; see `Rig.safe_stop`."""
        self.driver.safe_stop()

    def close(self) -> None:
        """Set the drives to zero and release the hardware; see `Rig.close`."""
        self.driver.close()

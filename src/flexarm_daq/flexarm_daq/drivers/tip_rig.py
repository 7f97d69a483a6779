"""Simulated rig with sensors at the tip: a camera that sees it, and an accelerometer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flexarm_core.channels import CHANNEL_NAMES
from flexarm_core.errors import SettingError, nearest
from flexarm_core.signals import RigSample
from flexarm_daq.rigs.late_readings import LateReadings, SensorSettings
from flexarm_daq.rigs.rig_parameters import NO_HUM_V, RigParameters
from flexarm_daq.rigs.simulated import SimulatedRig

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

TIP_ANGLE, TIP_ACCELERATION = "tip_rad", "tip_m_per_s2"
SENSORS: Final = (*CHANNEL_NAMES, TIP_ANGLE, TIP_ACCELERATION)
"""Sensors of the arm: the thesis's in V, direction of the tip from the axis, its acceleration."""


class TipSettings(SensorSettings):
    """Settings of the driver `simulated` for another rig than the thesis's.

    Each sensor is one of `SENSORS`; the payload is a point mass at the tip.

    Raises
    ------
    SettingError
        If there is no such sensor, or as of `SensorSettings`.
    """

    def __post_init__(self) -> None:
        for name in self.sensors:
            if name not in SENSORS:
                raise SettingError(
                    f"settings.sensors has {name!r}{nearest(name, SENSORS)}: the simulated arm has "
                    f"{', '.join(SENSORS)}"
                )
        super().__post_init__()


class TipRig:
    """A `flexarm_daq.rigs.rig_protocol.Rig`: the simulated arm with other sensors.

    The accelerometer measures the mean since the last sample, which a filter at half the sampling
    rate leaves of it.

    Parameters
    ----------
    settings : TipSettings
        Sensors, their noise and delay, and the payload.

    Raises
    ------
    SettingError
        If a number is out of range.
    """

    def __init__(self, settings: TipSettings) -> None:
        self._settings = settings
        self._rig = SimulatedRig(
            RigParameters(payload_kg=settings.payload_kg, noise_v=NO_HUM_V),
            rate_hz=settings.rate_hz,
        )
        self._places = [SENSORS.index(name) for name in settings.sensors]

    @property
    def clock(self) -> Callable[[], float] | None:
        """Monotonic time in s of an arm in real time; None in virtual time."""
        return self._rig.clock

    @clock.setter
    def clock(self, clock: Callable[[], float] | None) -> None:
        self._rig.clock = clock

    @property
    def has_virtual_time(self) -> bool:
        """Whether time stands still between the samples."""
        return self._rig.has_virtual_time

    def tip_rad(self) -> float:
        """Return the present direction of the tip from the axis, rad."""
        return self._rig.plant.tip()[0]

    def open(self) -> None:
        """Start at rest in the middle of the travel, at time zero; see `Rig.open`."""
        self._rig.open()
        self._late = LateReadings(self._settings)
        self._before = 0.0, 0.0

    def read(self) -> RigSample:
        """Sample the sensors; see `Rig.read`."""
        time_s, volts, _ = self._rig.read()
        angle_rad, speed_rad_per_s = self._rig.plant.tip()
        before_s, before_rad_per_s = self._before
        gained = (speed_rad_per_s - before_rad_per_s) * self._rig.parameters.length_m
        acceleration = gained / (time_s - before_s) if time_s > before_s else 0.0
        self._before = time_s, speed_rad_per_s
        readings = np.array([*volts, angle_rad, acceleration])[self._places]
        return RigSample(time_s, self._late(time_s, readings))

    def write(self, commands: Sequence[float]) -> None:
        """Command the drive; see `Rig.write`."""
        self._rig.write(commands)

    def safe_stop(self) -> None:
        """Set the drive to zero; never raises."""
        self._rig.safe_stop()

    def close(self) -> None:
        """Set the drive to zero and close; `open` starts again from rest."""
        self._rig.close()

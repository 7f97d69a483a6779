"""Sensors of a simulated rig: noise, and readings that come late or in frames, as a camera's."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray

# Instants are sums of steps: what is due now is not left to the next sample.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class SensorSettings:
    """Settings of a simulated rig that its description gives the sensors.

    Attributes
    ----------
    sensors : tuple of str
        Sensor of each output.
    noise : tuple of float
        Standard deviation of the noise of each output, in the units of the sensor.
    delay_s : tuple of float
        Age of what each output reads, s: a camera's exposure and computation.
    frame_hz : tuple of float
        Frames a second of each output, which is held between them; 0 for each sample anew.
    seed : int
        Seed of the noise.
    payload_kg : float
        Mass of the payload.
    rate_hz : float
        Sampling rate, Hz.

    Raises
    ------
    SettingError
        If a number is negative, or a list has not one for every output.
    """

    sensors: tuple[str, ...]
    noise: tuple[float, ...] = ()
    delay_s: tuple[float, ...] = ()
    frame_hz: tuple[float, ...] = ()
    seed: int = 0
    payload_kg: float = 0.0
    rate_hz: float = 300.0

    def __post_init__(self) -> None:
        require_from_zero(self, "seed", "payload_kg")
        for name in ("noise", "delay_s", "frame_hz"):
            numbers = getattr(self, name)
            if numbers and (len(numbers) != len(self.sensors) or min(numbers) < 0.0):
                raise SettingError(
                    f"settings.{name} needs a number from 0 on for each of the "
                    f"{len(self.sensors)} sensors, got {', '.join(map(str, numbers))}"
                )


def require_from_zero(settings: object, *names: str) -> None:
    """Refuse settings below zero; SettingError names the first."""
    for name in names:
        if getattr(settings, name) < 0:
            raise SettingError(f"settings.{name} = {getattr(settings, name)} must not be negative")


class LateReadings:
    """Readings of a rig's outputs, with noise, each given when it is old enough.

    Parameters
    ----------
    settings : SensorSettings
        Noise, delays and frames.
    """

    def __init__(self, settings: SensorSettings) -> None:
        none = [0.0] * len(settings.sensors)
        self._noise = np.array(settings.noise or none)
        self._random = np.random.default_rng(settings.seed)
        self._delay_s = np.array(settings.delay_s or none)
        self._frame_hz = np.array(settings.frame_hz or none)
        self._framed = self._frame_hz > 0.0
        self._taken: deque[tuple[float, FloatArray]] = deque()

    def __call__(self, now_s: float, outputs: FloatArray) -> FloatArray:
        """Take the outputs of an instant, and return what each of them reads now."""
        noise = self._noise * self._random.standard_normal(len(self._noise))
        self._taken.append((now_s, outputs + noise))
        due_s, frame_hz = now_s - self._delay_s, self._frame_hz[self._framed]
        due_s[self._framed] = np.floor(due_s[self._framed] * frame_hz + _ROUNDING) / frame_hz
        due_s += _ROUNDING
        while len(self._taken) > 1 and self._taken[1][0] <= due_s.min():
            self._taken.popleft()
        read = self._taken[0][1].copy()
        for taken_s, readings in self._taken:
            read = np.where(taken_s <= due_s, readings, read)
        return read

"""Readings that an output gives late or in frames, as a camera does."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray

# Instants are sums of steps: what is due now is not left to the next sample.
_ROUNDING = 1e-9


class LateReadings:
    """Readings of a rig's outputs, each given when it is old enough.

    Parameters
    ----------
    delay_s : sequence of float
        Age of what each output reads, s: a camera's exposure and computation.
    frame_hz : sequence of float
        Frames a second of each output, which is held between them; 0 for each sample anew.
    """

    def __init__(self, delay_s: Sequence[float], frame_hz: Sequence[float]) -> None:
        self._delay_s, self._frame_hz = np.array(delay_s), np.array(frame_hz)
        self._framed = self._frame_hz > 0.0
        self._taken: deque[tuple[float, FloatArray]] = deque()

    def __call__(self, now_s: float, outputs: FloatArray) -> FloatArray:
        """Take the outputs of an instant, and return what each of them reads now."""
        self._taken.append((now_s, outputs))
        due_s, frame_hz = now_s - self._delay_s, self._frame_hz[self._framed]
        due_s[self._framed] = np.floor(due_s[self._framed] * frame_hz + _ROUNDING) / frame_hz
        due_s += _ROUNDING
        while len(self._taken) > 1 and self._taken[1][0] <= due_s.min():
            self._taken.popleft()
        told = self._taken[0][1].copy()
        for taken_s, readings in self._taken:
            told = np.where(taken_s <= due_s, readings, told)
        return told


def require_one_each(sensors: Sequence[str], settings: object) -> None:
    """Refuse noise, delays or frames that have no number from 0 on for each sensor.

    Raises
    ------
    SettingError
        If one has another number of entries, or a negative one.
    """
    for name in ("noise", "delay_s", "frame_hz"):
        numbers = getattr(settings, name)
        if numbers and (len(numbers) != len(sensors) or min(numbers) < 0.0):
            raise SettingError(
                f"settings.{name} needs a number from 0 on for each of the {len(sensors)} sensors, "
                f"got {', '.join(map(str, numbers))}"
            )

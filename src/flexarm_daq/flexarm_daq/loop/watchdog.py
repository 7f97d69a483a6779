"""Watchdog on the age of the command: a silent or a late controller must not drive the arm on."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from flexarm_core.errors import SettingError

_USUAL_PERIODS = 3
# A busy machine stops any process for a millisecond or two, now and then. Above 1 kHz that would
# take the drive to zero each time, and the arm would get a pulse.
_SHORTEST_S = 3e-3


class _Sample(NamedTuple):
    sequence: int
    time_s: float


def usual_age_periods(rate_hz: float) -> int:
    """Return the age of a stale command where none is set: 3 periods, and at least 3 ms."""
    return max(_USUAL_PERIODS, math.ceil(round(_SHORTEST_S * rate_hz, 6)))


class Watchdog:
    """Check of the age of the command in force.

    A command is as old as the sample that it answers, whenever it arrives. Its age is counted in
    samples. Since the numbers of samples come from the loop's clock, it is measured by the rig's
    clock too. Half a period is allowed there for samples that come a little early or late.

    A command has to come a period before it is stale. One that came later would act for the rest of
    that period, and with a constant delay the drive would be pulsed: on and off in every period.

    Parameters
    ----------
    period_s : float
        Sampling period, s.
    max_age_periods : int
        Samples, or periods of time, after which a command is stale. With 1, a command acts until
        the next sample; 0 takes `usual_age_periods`.

    Raises
    ------
    SettingError
        If the period is not positive or the age is negative.
    """

    def __init__(self, period_s: float, max_age_periods: int = 0) -> None:
        if not 0.0 < period_s < math.inf:
            raise SettingError(f"period_s must be positive, got {period_s}")
        if max_age_periods < 0:
            raise SettingError(f"max_age_periods must be at least 0, got {max_age_periods}")
        self._period_s = period_s
        self._stale_periods = max_age_periods or usual_age_periods(1.0 / period_s)
        self._late_periods = max(1, self._stale_periods - 1)
        self._recent: deque[_Sample] = deque(maxlen=self._stale_periods)
        self._answered: _Sample | None = None

    @property
    def longest_answer_s(self) -> float:
        """Longest time from a sample to a command that may begin to act, s."""
        return self._late_periods * self._period_s

    def stale(self, sequence: int, time_s: float) -> bool:
        """Take note of a sample, and return whether no command is young enough for it.

        Parameters
        ----------
        sequence : int
            Number of the sample's period.
        time_s : float
            Time of the sample by the rig's clock, s.
        """
        self._recent.append(_Sample(sequence, time_s))
        if self._answered is not None and self._is_old(self._answered, self._stale_periods):
            self._answered = None
        return self._answered is None

    def in_time(self, sequence: int) -> bool:
        """Return whether a command that answers this sample is young enough to begin to act."""
        sample = self._find(sequence)
        return sample is not None and not self._is_old(sample, self._late_periods)

    def fed(self, sequence: int) -> None:
        """Take note of a command in time, by the number of the sample that it answers."""
        self._answered = self._find(sequence)

    def _find(self, sequence: int) -> _Sample | None:
        return next((each for each in reversed(self._recent) if each.sequence == sequence), None)

    def _is_old(self, sample: _Sample, periods: int) -> bool:
        newest = self._recent[-1]
        return (
            newest.sequence - sample.sequence >= periods
            or newest.time_s - sample.time_s > self._period_s * (periods - 0.5)
        )

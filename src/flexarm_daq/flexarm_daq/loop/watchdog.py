"""Watchdog on the age of the command: a silent controller must not drive the arm on."""

from __future__ import annotations

import math

from flexarm_core.errors import SettingError


class Watchdog:
    """Check of the age of the last command.

    The age of a command is counted in samples from the one that it answers. Since samples may be
    missing, it is measured in time too. Half a period is allowed for samples that come a little
    early or late.

    Parameters
    ----------
    period_s : float
        Sampling period, s.
    max_age_periods : int
        Samples, or periods of time, after which a command is stale.

    Attributes
    ----------
    feeds : int
        Commands seen.
    lapses : int
        Number of times that a fresh command has turned stale.

    Raises
    ------
    SettingError
        If the period is not positive or the age is not at least one period.
    """

    def __init__(self, period_s: float, max_age_periods: int = 3) -> None:
        if not 0.0 < period_s < math.inf:
            raise SettingError(f"period_s must be positive, got {period_s}")
        if max_age_periods < 1:
            raise SettingError(f"max_age_periods must be at least 1, got {max_age_periods}")
        self.feeds = 0
        self.lapses = 0
        self._max_age_samples = max_age_periods
        self._max_age_s = period_s * (max_age_periods - 0.5)
        self._fed_s = -math.inf
        self._samples = 0
        self._is_fresh = False

    def fed(self, now_s: float) -> None:
        """Note a command, with the monotonic time of the sample that it answers."""
        self.feeds += 1
        self._fed_s = now_s
        self._samples = 0
        self._is_fresh = True

    def stale(self, now_s: float) -> bool:
        """Return whether the last command is too old, or none has come; called once per sample."""
        self._samples += 1
        is_old = self._samples >= self._max_age_samples or now_s - self._fed_s > self._max_age_s
        if self._is_fresh and is_old:
            self._is_fresh = False
            self.lapses += 1
        return not self._is_fresh

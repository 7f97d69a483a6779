"""Watchdog on the age of the command: a silent controller must not drive the arm on."""

from __future__ import annotations

import math

from flexarm_core.errors import SettingError


class Watchdog:
    """Tells whether the last command is too old to be in force.

    The age of a command is counted in samples from the one that it answers. Time counts beside
    them, since samples may be missing: with half a period to spare, as they come a little early or
    late.

    Parameters
    ----------
    period_s : float
        Sampling period.
    max_age_periods : int
        So many samples, or the time of so many periods, after the sample that it answers a command
        is stale.

    Attributes
    ----------
    feeds : int
        Commands seen.
    lapses : int
        How often a fresh command has turned stale.

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
        """Note a command.

        Parameters
        ----------
        now_s : float
            Monotonic time of the sample that it answers.
        """
        self.feeds += 1
        self._fed_s = now_s
        self._samples = 0
        self._is_fresh = True

    def stale(self, now_s: float) -> bool:
        """Tell whether no command is in force: asked once at every sample.

        Parameters
        ----------
        now_s : float
            Monotonic time of the sample.

        Returns
        -------
        bool
            True if the last command is too old, or none has come yet.
        """
        self._samples += 1
        is_old = self._samples >= self._max_age_samples or now_s - self._fed_s > self._max_age_s
        if self._is_fresh and is_old:
            self._is_fresh = False
            self.lapses += 1
        return not self._is_fresh

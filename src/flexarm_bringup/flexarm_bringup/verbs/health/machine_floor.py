"""Floor of a machine: how late a bare loop wakes that only sleeps until each of its deadlines.

No loop of nodes on the same machine can be better.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexarm_daq.loop.watchdog import usual_age_periods
from flexarm_node.statistics import Percentiles, Window

if TYPE_CHECKING:
    from collections.abc import Callable

_MARGIN = 0.5


@dataclass(frozen=True)
class Floor:
    """What a bare loop did.

    Attributes
    ----------
    rate_hz : float
        Its rate, Hz.
    late : Percentiles
        How late it woke, s.
    periods, missed : int
        Periods of its time, and those that it left out to catch up.
    gaps : int
        Times that it left out so many at once that a DAQ node would have taken the drive to zero,
        with the default of its `max_age_periods`.
    """

    rate_hz: float
    late: Percentiles
    periods: int
    missed: int
    gaps: int

    @property
    def kept(self) -> bool:
        """Whether no period was missed, and 999 of 1000 left half of their time to the nodes."""
        return self.missed == 0 and self.late.p999 * self.rate_hz <= _MARGIN


def sleep_floor(
    rate_hz: float,
    length_s: float,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Floor:
    """Sleep until each deadline of a time, and return how late that was.

    Parameters
    ----------
    rate_hz : float
        Rate of the deadlines, Hz.
    length_s : float
        Time, s.
    clock, sleep : callable, optional
        Steady time, s, and the wait of some seconds.

    Returns
    -------
    Floor
        Lateness and missed periods.
    """
    period_s = 1.0 / rate_hz
    periods = max(1, round(rate_hz * length_s))
    late = Window(periods)
    # Behind so many the next sample finds a stale command.
    gap_periods = usual_age_periods(rate_hz) - 1
    start_s = clock()
    number = missed = gaps = 0
    while number < periods:
        # A deadline that is less than a period ago is still met, late.
        behind = (clock() - start_s) / period_s - number
        skipped = min(periods - number - 1, max(0, int(behind - 1.0)))
        missed += skipped
        gaps += skipped >= gap_periods
        number += 1 + skipped
        deadline_s = start_s + number * period_s
        sleep(max(0.0, deadline_s - clock()))
        late.add(clock() - deadline_s)
    return Floor(rate_hz, late.percentiles(), periods, missed, gaps)

"""Real time of this machine: the rates that a bare loop keeps here, and which one to take."""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import takewhile
from typing import TYPE_CHECKING, Final

from rich.table import Table

from flexarm_bringup.console import terminal
from flexarm_daq.loop.watchdog import usual_age_periods
from flexarm_node.process import prefer_realtime
from flexarm_node.statistics import Percentiles, Window

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

RATES_HZ: Final = (100.0, 300.0, 500.0, 1000.0, 2000.0)
_LENGTH_S: Final = 5.0
_ONE_PROCESS_HZ: Final = 1000.0
_MARGIN = 0.5


def examine_realtime() -> None:
    """Run a bare loop at some rates, print how late it was, and say what that means."""
    prefer_realtime()
    floors = []
    for rate_hz in RATES_HZ:
        terminal.step(f"a bare loop at {rate_hz:g} Hz for {_LENGTH_S:g} s")
        floors.append(sleep_floor(rate_hz, _LENGTH_S))
    terminal.show_table(_table(floors))
    terminal.CONSOLE.print(verdict(floors))


def verdict(floors: Sequence[Floor]) -> str:
    """Return which rate the machine can promise, and the next step; `floors` by their rates."""
    kept = list(takewhile(lambda floor: floor.kept, floors))
    if not kept:
        worst_ms = 1e3 * floors[0].late.maximum
        return (
            f"no rate can be promised: at {floors[0].rate_hz:g} Hz the loop was up to "
            f"{worst_ms:.0f} ms late. End other programs, or permit real-time priority "
            "(`ulimit -r`). The simulated rig loses nothing here: its time waits for the machine"
        )
    promise_hz = kept[-1].rate_hz
    way = " in one process (up --compose)" if promise_hz >= _ONE_PROCESS_HZ else ""
    return (
        f"{promise_hz:g} Hz is kept{way}: nothing missed, and half of the period left to the nodes "
        "in 999 of 1000. Measure again while all programs of a working day run"
    )


def _table(floors: Sequence[Floor]) -> Table:
    table = Table("rate Hz", "late p50 ms", "p99 ms", "p99.9 ms", "worst ms", "missed", "kept")
    for floor in floors:
        late = floor.late
        figures = (late.p50, late.p99, late.p999, late.maximum)
        table.add_row(
            f"{floor.rate_hz:g}",
            *(f"{1e3 * figure_s:.2f}" for figure_s in figures),
            f"{floor.missed} of {floor.periods}",
            "yes" if floor.kept else "no",
        )
    return table


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

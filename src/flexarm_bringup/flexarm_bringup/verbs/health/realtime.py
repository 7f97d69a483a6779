"""Real time of this machine: the rates that a bare loop keeps here, and which one to take."""

from __future__ import annotations

from itertools import takewhile
from typing import TYPE_CHECKING, Final

from rich.table import Table

from flexarm_bringup.console import terminal
from flexarm_bringup.verbs.health.machine_floor import sleep_floor
from flexarm_node.process import prefer_realtime

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_bringup.verbs.health.machine_floor import Floor

RATES_HZ: Final = (100.0, 300.0, 500.0, 1000.0, 2000.0)
_LENGTH_S: Final = 5.0
_ONE_PROCESS_HZ: Final = 1000.0


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

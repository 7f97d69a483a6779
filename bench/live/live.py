"""Benchmark of the live page: what it costs the loop, and how soon it shows and does things.

`up` with the simulated rig in real time, its page in a headless Chromium, and clients that speak to
its socket. What the machine itself gives is measured beside: a bare loop that only sleeps, phases
with nobody looking on, the frames of an empty page, the start of a bare Python.
"""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NamedTuple

import click
import pytest
from rich.table import Table

from bench.live.drawing import DRAWING, drawing_part
from bench.live.figures import HEADS, Row
from bench.live.laboratory import laboratory
from bench.live.load import LOOP, SLOW, loop_part, slow_part
from bench.live.reactions import STOP, VERBS, stop_part, verbs_part
from bench.tools import json_option, write_json, write_table
from flexarm_bringup.console import terminal
from flexarm_core.errors import FlexarmError, one_line
from support.browser import CHROMIUM, Browser

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_PAGE = Path(__file__).parents[2] / "docs" / "performance.md"
_PARTS = (LOOP, SLOW, DRAWING, STOP, VERBS)


class Extent(NamedTuple):
    """Length of a measurement.

    Attributes
    ----------
    rounds : int
        Rounds of phases with onlookers.
    window_s : float
        Length of a phase.
    slow_s, drawing_s : float
        How long the slow client and the drawing are watched.
    times : int
        How often each reaction is timed.
    """

    rounds: int = 3
    window_s: float = 10.0
    slow_s: float = 60.0
    drawing_s: float = 60.0
    times: int = 20


_QUICK = Extent(rounds=1, window_s=3.0, slow_s=25.0, drawing_s=5.0, times=3)


@click.command()
@click.option(
    "--part", "parts", type=click.Choice(_PARTS), multiple=True, help="One part; repeat for more."
)
@click.option(
    "--rate", "rate_hz", type=click.FloatRange(10.0, 2000.0), default=500.0, show_default=True,
    help="Hz.",
)  # fmt: skip
@click.option("--quick", is_flag=True, help="A short form of two minutes.")
@json_option
@click.option("--docs", is_flag=True, help="Write the table of docs/performance.md.")
def main(
    *, parts: tuple[str, ...], rate_hz: float, quick: bool, json_file: Path | None, docs: bool
) -> None:
    """Measure the page of a running arm, print one table, and write it to files on request."""
    if CHROMIUM is None:
        raise click.ClickException("no Chromium on PATH: the page is measured in it")
    rows = []
    try:
        for row in measured(parts or _PARTS, rate_hz, _QUICK if quick else Extent()):
            rows.append(row)
            terminal.CONSOLE.print("  ".join(row.cells()), style="dim")
    except (FlexarmError, pytest.fail.Exception) as error:
        raise click.ClickException(one_line(error)) from None
    table = Table(*HEADS)
    for row in rows:
        table.add_row(*row.cells())
    terminal.show_table(table)
    write_json(json_file, rows)
    if docs:
        write_table(_PAGE, "live", HEADS, [row.cells() for row in rows])


def measured(parts: Sequence[str], rate_hz: float, extent: Extent) -> Iterator[Row]:
    """Run a laboratory and measure these parts of it."""
    yield Row("machine", "load average before the run", os.getloadavg()[0])
    yield Row("machine", "cores", os.cpu_count() or 1)
    browser = Browser()
    with ExitStack() as stack:
        if set(parts) & {LOOP, DRAWING, STOP}:
            stack.enter_context(browser)
        folder = stack.enter_context(TemporaryDirectory(prefix="flexarm_bench_"))
        lab = stack.enter_context(laboratory(rate_hz, extent.window_s, Path(folder)))
        if LOOP in parts:
            yield from loop_part(lab, browser, extent.rounds)
        if SLOW in parts:
            yield from slow_part(lab, extent.slow_s)
        if DRAWING in parts:
            yield from drawing_part(lab, browser, extent.drawing_s)
        if STOP in parts:
            yield from stop_part(lab, browser, extent.times)
        if VERBS in parts:
            yield from verbs_part(lab, extent.times)


if __name__ == "__main__":
    main()

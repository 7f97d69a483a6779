"""Load of onlookers: the loop with and without them, and memory for one that reads nothing."""

from __future__ import annotations

import math
import time
from contextlib import ExitStack, nullcontext
from typing import TYPE_CHECKING

from bench.live.figures import Phase, Row, loop_rows
from bench.live.pages import is_served, resident_mb, silent_client, tabs
from bench.loop.loop import beside, floor_of, sleep_floor
from bench.tools import process_cpu_s

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from bench.live.laboratory import Laboratory
    from support.browser import Browser

LOOP, SLOW = "loop", "slow"
_ALLOWANCE = 0.05
_MOST_MB = 20.0
_SETTLE_S = 2.0
_REPORT_S = 1.2
"""Reports come once a second."""
_LOOK_S = 0.2
_TABS = (1, 5)


def loop_part(lab: Laboratory, browser: Browser, rounds: int) -> list[Row]:
    """Measure the loop with onlookers, each between two phases with nobody."""
    alone = [phase(lab, nullcontext())]
    onlookers: dict[str, list[Phase]] = {}
    for _ in range(rounds):
        for who, shown in _onlookers(lab, browser).items():
            onlookers.setdefault(who, []).append(phase(lab, shown))
            alone.append(phase(lab, nullcontext()))
    return loop_rows(LOOP, alone, onlookers, _ALLOWANCE)


def _onlookers(lab: Laboratory, browser: Browser) -> dict[str, AbstractContextManager[object]]:
    pages = {"1 page": tabs(browser, lab, 1), "5 pages": tabs(browser, lab, 5)}
    return {**pages, "a client that reads nothing": silent_client(lab)}


def phase(lab: Laboratory, onlookers: AbstractContextManager[object]) -> Phase:
    """Return the loop's figures over its window while somebody looks on."""
    length_s = lab.window_s + _REPORT_S
    with ExitStack() as stack:
        stack.enter_context(onlookers)
        time.sleep(_SETTLE_S)
        floor = stack.enter_context(beside(sleep_floor, lab.rate_hz, length_s))
        before, used_s, start_s = lab.report(), process_cpu_s(lab.live_pid), time.monotonic()
        bare = floor_of(floor)
        used_s, elapsed_s = process_cpu_s(lab.live_pid) - used_s, time.monotonic() - start_s
        after = lab.report()
    counts = {
        name: int(after[name]) - int(before[name])
        for name in ("missed periods", "unanswered samples")
    }
    return Phase(
        reply_p50_ms=float(after["reply p50 ms"]),
        reply_p99_ms=float(after["reply p99 ms"]),
        late_p99_ms=float(after["late p99 ms"]),
        missed=counts["missed periods"],
        unanswered=counts["unanswered samples"],
        floor_late_p99_ms=1e3 * bare.late.p99,
        floor_missed=bare.missed,
        live_cpu=used_s / elapsed_s,
    )


def slow_part(lab: Laboratory, length_s: float) -> list[Row]:
    """Measure what a client that reads nothing costs, and when it is dropped."""
    most_mb = before_mb = resident_mb(lab.live_pid)
    dropped_s = math.nan
    missed = int(lab.report()["missed periods"])
    with silent_client(lab) as client, beside(sleep_floor, lab.rate_hz, length_s) as floor:
        start_s = time.monotonic()
        while (elapsed_s := time.monotonic() - start_s) < length_s:
            most_mb = max(most_mb, resident_mb(lab.live_pid))
            if math.isnan(dropped_s) and not is_served(lab, client):
                dropped_s = elapsed_s
            time.sleep(_LOOK_S)
        bare = floor_of(floor)
    missed = int(lab.report()["missed periods"]) - missed
    return [
        Row(SLOW, "memory of the live node, growth", most_mb - before_mb, "MB", most=_MOST_MB),
        Row(SLOW, "client dropped after", dropped_s, "s", most=length_s),
        Row(SLOW, "missed periods, line: a bare loop's", missed, most=bare.missed),
    ]

"""Benchmark of the loop: daq and controller over DDS, beside peers in C and a bare Python loop.

The simulated rig in real time. Lateness of the ticks, time from a sample to its command, missed
periods and unanswered samples are what the DAQ node reports of itself on `/diagnostics`. The floor
is a Python loop that only sleeps until its next deadline, in a process of its own at the same time
and priority: what it misses, this machine makes every Python program miss.

The peers are C programs that exchange as many bytes: on rcl, and as bare datagrams. All take turns
in rounds, since a shared machine drifts. A figure is the median of the rounds, a maximum that of
all, and a ratio is formed within each round.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from statistics import fmean, median
from typing import TYPE_CHECKING, Any

import click
from diagnostic_msgs.msg import DiagnosticArray
from rich.progress import track
from rich.table import Table

from bench.loop import peers
from bench.tools import cpu_s, json_option, write_json
from flexarm_bringup.console import terminal
from flexarm_bringup.graph.laboratory import running_graph
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.health import realtime
from flexarm_node import qos
from flexarm_node.process import prefer_realtime

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from multiprocessing.connection import Connection

_SETTLE_S = 2.0
_ROUND_S = 20.0
_COUNTS = ("samples", "missed periods", "unanswered samples", "events: stale")
_PERCENTILES = {"p50": "p50", "p99": "p99", "p999": "p999", "max": "maximum"}


@dataclass(frozen=True)
class Row:
    """Figures of a run or of its rounds; times in ms, CPU as a share of one core per process.

    `floor_gaps` are the stalls of the bare loop after which a drive would fall to its safe state.
    `composed` tells that daq and controller were one process.

    `peer_reply_ms` and `udp_reply_ms` are those of the peers, empty where they cannot be built, and
    `ratio_to_peer` is that of the reply.
    """

    asked_hz: float
    rate_hz: float
    reply_ms: dict[str, float]
    late_ms: dict[str, float]
    floor_late_ms: dict[str, float]
    samples: int
    missed: int
    floor_missed: int
    unanswered: int
    fell_safe: int
    floor_gaps: int
    cpu: dict[str, float]
    realtime: bool
    load: bool
    composed: bool = False
    peer_reply_ms: dict[str, float] = field(default_factory=dict)
    udp_reply_ms: dict[str, float] = field(default_factory=dict)
    ratio_to_peer: dict[str, float] = field(default_factory=dict)


@click.command()
@click.option(
    "--rate", "rates_hz", type=click.FloatRange(10.0, 2000.0), multiple=True, default=(300.0,),
    show_default=True, help="Hz; repeat for several.",
)  # fmt: skip
@click.option("--minutes", type=click.FloatRange(0.05), default=1.0, show_default=True)
@click.option("--load", is_flag=True, help="Keep one core busy beside it.")
@json_option
def main(
    *, rates_hz: tuple[float, ...], minutes: float, load: bool, json_file: Path | None
) -> None:
    """Measure each rate, print one table, and write its rows to a file on request."""
    programs, missing = peers.built(Path("out/bench/peer"))
    try:
        rows = [
            row
            for rate_hz in rates_hz
            for row in compared(rate_hz, 60.0 * minutes, programs, load=load)
        ]
    except LaunchError as error:
        raise click.ClickException(str(error)) from None
    terminal.show_table(table(rows))
    for line in missing:
        terminal.CONSOLE.print(line)
    if not all(row.realtime for row in rows):
        terminal.CONSOLE.print(
            "Without real-time priority, which this account may not take: a busy machine shows."
        )
    write_json(json_file, rows)


def compared(
    rate_hz: float, length_s: float, programs: Mapping[str, Path], *, load: bool
) -> tuple[Row, Row]:
    """Measure the loop in two processes, in one, and its peers, in turns; return both rows."""
    rounds = max(1, round(length_s / _ROUND_S))
    apart: list[Row] = []
    composed: list[Row] = []
    for _ in range(rounds):
        with beside(_burn) if load else nullcontext():
            replies = {
                name: peers.measured(program, rate_hz, length_s / rounds)
                for name, program in programs.items()
            }
        for rows, compose in ((apart, False), (composed, True)):
            row = measure(rate_hz, length_s / rounds, load=load, compose=compose)
            rows.append(_beside_peers(row, replies))
    return joined(apart), joined(composed)


def _beside_peers(row: Row, replies: Mapping[str, Mapping[str, float]]) -> Row:
    """Return a row with the replies of the peers in the same round."""
    rcl, udp = (
        {name: replies[peer][name] for name in _PERCENTILES} if peer in replies else {}
        for peer in (peers.RCL, peers.UDP)
    )
    ratio = {name: row.reply_ms[name] / rcl[name] for name in rcl}
    return replace(row, peer_reply_ms=rcl, udp_reply_ms=udp, ratio_to_peer=ratio)


def joined(rows: Sequence[Row]) -> Row:
    """Return one row for all rounds: sums of counts, medians of times, means of the rest."""
    first = asdict(rows[0])
    every = {name: [getattr(row, name) for row in rows] for name in first}
    together: dict[str, Any] = {}
    for name, values in every.items():
        if isinstance(first[name], dict):
            together[name] = {
                key: (max if key == "max" else median)([value[key] for value in values])
                for key in first[name]
            }
        elif isinstance(first[name], bool):
            together[name] = all(values)
        else:
            together[name] = sum(values) if isinstance(first[name], int) else fmean(values)
    return Row(**together)


def measure(rate_hz: float, length_s: float, *, load: bool, compose: bool = False) -> Row:
    """Run the loop for that long and return what it and the floor report."""
    parameters: dict[str, dict[str, Any]] = {
        "daq": {"rate_hz": rate_hz, "statistics_s": length_s, "time": "real"},
        "controller": {"law": "pdpc", "reference": "square", "square.amplitude_v": 2.0},
    }
    log = Path("out/bench/loop.log")
    with ExitStack() as stack:
        operator, processes = stack.enter_context(
            running_graph(parameters, log, nodes=("controller", "daq"), compose=compose)
        )
        if load:
            stack.enter_context(beside(_burn))
        heard: dict[str, str] = {}
        operator.listen(DiagnosticArray, "/diagnostics", qos.SENT, _keep("daq", heard))
        operator.activate("controller")
        operator.activate("daq")
        operator.wait(lambda: int(heard.get("samples", 0)) > _SETTLE_S * rate_hz, "samples")
        floor = stack.enter_context(beside(sleep_floor, rate_hz, length_s))
        begun = {name: int(heard[name]) for name in _COUNTS}
        first_s = float(heard["time_s"])
        begun_s = cpu_s(processes)
        for _ in track(range(round(length_s)), f"{rate_hz:g} Hz"):
            until_s = time.monotonic() + 1.0
            operator.wait(lambda until=until_s: time.monotonic() >= until, "time")  # type: ignore[misc]
        used_s = {name: value - begun_s[name] for name, value in cpu_s(processes).items()}
        operator.wait(lambda: float(heard["time_s"]) >= first_s + length_s, "the last report")
        elapsed_s = float(heard["time_s"]) - first_s
        bare = floor_of(floor)
        counts = {name: int(heard[name]) - before for name, before in begun.items()}
        return Row(
            asked_hz=rate_hz,
            rate_hz=counts["samples"] / elapsed_s,
            reply_ms=_read(heard, "reply"),
            late_ms=_read(heard, "late"),
            floor_late_ms={
                name: 1e3 * getattr(bare.late, field) for name, field in _PERCENTILES.items()
            },
            samples=counts["samples"],
            missed=counts["missed periods"],
            floor_missed=bare.missed,
            unanswered=counts["unanswered samples"],
            fell_safe=counts["events: stale"],
            floor_gaps=bare.gaps,
            cpu={name: value / elapsed_s for name, value in used_s.items()},
            realtime=_may_take_priority(),
            load=load,
            composed=compose,
        )


def table(rows: list[Row]) -> Table:
    """Return the table that is printed: one column per rate and number of processes."""
    heads = (
        f"{row.asked_hz:g} Hz{' + load' * row.load}{', one process' * row.composed}" for row in rows
    )
    result = Table("", *heads)
    lines: dict[str, list[str]] = {
        "rate, Hz": [f"{row.rate_hz:.2f}" for row in rows],
        "missed periods (floor)": [f"{row.missed} ({row.floor_missed})" for row in rows],
        "unanswered": [f"{row.unanswered / row.samples:.2%}" for row in rows],
        "falls to safe state (floor)": [f"{row.fell_safe} ({row.floor_gaps})" for row in rows],
    }
    for title, kind in (("reply", "reply_ms"), ("late", "late_ms"), ("floor", "floor_late_ms")):
        for name in _PERCENTILES:
            lines[f"{title} {name}, ms"] = [f"{getattr(row, kind)[name]:.3f}" for row in rows]
    for title, kind in (("C on rcl", "peer_reply_ms"), ("datagrams in C", "udp_reply_ms")):
        for name in ("p50", "p99"):
            found = [getattr(row, kind).get(name) for row in rows]
            lines[f"{title} {name}, ms"] = ["-" if ms is None else f"{ms:.3f}" for ms in found]
    for name in ("p50", "p99"):
        ratios = [row.ratio_to_peer.get(name) for row in rows]
        lines[f"reply to that on rcl, {name}"] = ["-" if r is None else f"{r:.2f}" for r in ratios]
    for name in sorted({name for row in rows for name in row.cpu}):
        shares = [row.cpu.get(name) for row in rows]
        lines[f"{name}, share of a core"] = ["-" if s is None else f"{s:.1%}" for s in shares]
    for title, values in lines.items():
        result.add_row(title, *values)
    return result


@contextmanager
def beside(work: Any, *arguments: object) -> Iterator[Connection]:  # noqa: ANN401 - any function
    """Run a function in a process of its own; what it sends comes through the connection."""
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(
        target=work, args=(theirs, *arguments), daemon=True
    )
    process.start()
    # Else the end of the process would not end a wait for its answer.
    theirs.close()
    try:
        yield ours
    finally:
        process.kill()
        process.join()


def sleep_floor(result: Connection, rate_hz: float, length_s: float) -> None:
    """Send what the bare loop did."""
    prefer_realtime()
    result.send(realtime.sleep_floor(rate_hz, length_s))


def floor_of(result: Connection) -> realtime.Floor:
    """Return what the bare loop did, once it has ended."""
    floor: realtime.Floor = result.recv()
    return floor


def _burn(_: Connection) -> None:
    while True:
        pass


def _keep(name: str, heard: dict[str, str]) -> Any:  # noqa: ANN401 - a callback
    def on_message(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == f"/flexarm/{name}" and status.values:
                heard.update({each.key: each.value for each in status.values})
                heard["time_s"] = repr(time.monotonic())

    return on_message


def _read(heard: dict[str, str], what: str) -> dict[str, float]:
    return {name: float(heard[f"{what} {name} ms"]) for name in _PERCENTILES}


def _may_take_priority() -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        return False
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return True


if __name__ == "__main__":
    main()

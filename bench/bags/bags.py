"""Benchmark of reading bags: `read_bag` beside *rosbags* `AnyReader` with deserialisation.

An hour of samples at 500 Hz (1.8 million messages) is recorded by the project's writer, and 40 s
with commands. Both readers verify what they verify by default; `read_bag` verifies the checksum of
every chunk and of the summary. Both run on one core, and its time is what counts: other processes
of a busy machine change nothing.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import click
from rosbags.highlevel import AnyReader

from bench.bags.messages import RATE_HZ, STATE, TYPES, experiment, typestore
from bench.tools import json_option, make_table, write_json
from flexarm_bags.metadata import RecordedTopic
from flexarm_bags.schema import describe
from flexarm_bags.writer import BagWriter
from flexarm_bringup.console import terminal
from flexarm_ident.reading.read import read_bag

_SHORT_S = 40.0
_REPEATS = 3


@click.command()
@click.option("--seconds", type=click.FloatRange(1.0), default=3600.0, show_default=True)
@json_option
def main(seconds: float, json_file: Path | None) -> None:
    """Measure, print a table, and write the figures to a file on request."""
    samples = round(seconds * RATE_HZ)
    with tempfile.TemporaryDirectory(prefix="flexarm_bench_") as name:
        long = written(Path(name, "long"), samples, commands=False)
        short = written(Path(name, "short"), round(_SHORT_S * RATE_HZ), commands=True)
        by_read_bag = min(cpu_s(long) for _ in range(_REPEATS))
        by_any_reader = any_reader_cpu_s(long)
        short_s = min(elapsed_s(short) for _ in range(_REPEATS))
    figures = {
        "messages": samples,
        "read_bag_messages_per_s": samples / by_read_bag,
        "anyreader_messages_per_s": samples / by_any_reader,
        "ratio_to_anyreader": by_any_reader / by_read_bag,
        "read_bag_40_s_bag_s": short_s,
    }
    title = f"{samples} samples, {seconds:g} s at {RATE_HZ} Hz"
    table = make_table("reader", "CPU s", "messages/s", title=title)
    table.add_row("read_bag", f"{by_read_bag:.2f}", f"{samples / by_read_bag:.0f}")
    table.add_row("AnyReader", f"{by_any_reader:.2f}", f"{samples / by_any_reader:.0f}")
    terminal.show_table(table)
    terminal.CONSOLE.print(f"read_bag is {figures['ratio_to_anyreader']:.1f} times as fast")
    terminal.CONSOLE.print(f"a bag of {_SHORT_S:g} s with commands: {short_s:.3f} s")
    write_json(json_file, figures)


def written(path: Path, samples: int, *, commands: bool) -> Path:
    """Write a bag and return it."""
    names = list(TYPES) if commands else [STATE]
    topics = [RecordedTopic(name, describe(typestore(), TYPES[name])) for name in names]
    with BagWriter(path, topics) as bag:
        for topic, time_ns, raw in experiment(samples):
            if topic in names:
                bag.write(topic, raw, time_ns, time_ns)
    return path


def elapsed_s(bag: Path) -> float:
    """Return how long `read_bag` takes by the clock."""
    start_s = time.perf_counter()
    read_bag(bag)
    return time.perf_counter() - start_s


def cpu_s(bag: Path) -> float:
    """Return the CPU time of `read_bag`."""
    start_s = time.process_time()
    read_bag(bag)
    return time.process_time() - start_s


def any_reader_cpu_s(bag: Path) -> float:
    """Return the CPU time of deserialising every message with rosbags."""
    start_s = time.process_time()
    with AnyReader([bag]) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
    return time.process_time() - start_s


if __name__ == "__main__":
    main()

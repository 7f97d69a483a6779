"""Faults of bags: cut files, single wrong bits and mutated files, each with its verdict.

A bag of state and command at 500 Hz is cut at random bytes and repaired, checked with one bit wrong
at a time, and bags of several writers are mutated and read under a memory limit. It ends with exit
code 1 when a cut costs more than a second, a bit goes unnoticed, or reading ends with anything but
the one named error.
"""

from __future__ import annotations

import json
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import click
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rich.progress import track
from rosbags.rosbag2 import StoragePlugin, Writer

from bench.bags.messages import RATE_HZ, TYPES, experiment, typestore
from bench.tools import count_option, json_option, write_json
from flexarm_bags.check import check_bag
from flexarm_bags.metadata import RecordedTopic
from flexarm_bags.repair import repair_bag
from flexarm_bags.schema import describe
from flexarm_bags.writer import BagWriter, RecordingError
from flexarm_bringup.console import terminal
from flexarm_core.errors import BagError
from flexarm_ident.reading.read import read_bag

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    Mutation = Callable[[random.Random, bytes], bytes]

_MOST_LOST_S = 1.0
_MORE_MEMORY = 1 << 29
_CPU_S = 20.0
_HUGE = (0, 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**63, 2**64 - 1)


@click.command()
@click.option("--seconds", type=click.FloatRange(2.0), default=40.0, show_default=True)
@count_option("--cuts", 200)
@count_option("--flips", 600)
@count_option("--mutations", 1500)
@click.option("--seed", type=int, default=1, show_default=True)
@json_option
@click.option("--read", type=click.Path(exists=True, path_type=Path), hidden=True)
def main(
    *,
    seconds: float,
    cuts: int,
    flips: int,
    mutations: int,
    seed: int,
    json_file: Path | None,
    read: Path | None,
) -> None:
    """Run the three campaigns and print their results."""
    if read is not None:
        read_mutated(read, mutations, seed)
        return
    chance = random.Random(seed)  # noqa: S311 - chance, not secrecy
    with tempfile.TemporaryDirectory(prefix="flexarm_faults_") as name:
        folder = Path(name)
        bag = write_bag(folder / "whole", round(seconds * RATE_HZ))
        lost_s = [lost_by_cut(bag, folder, chance) for _ in _shown(range(cuts), "cuts")]
        unnoticed = [
            where
            for _ in _shown(range(flips), "wrong bits")
            if (where := unnoticed_bit(bag, chance))
        ]
        verdict = mutated(folder, mutations, seed)
    figures = {
        "cuts": cuts,
        "most_lost_s": max(lost_s),
        "flips": flips,
        "unnoticed_flips": len(unnoticed),
        "mutations": mutations,
        **verdict,
    }
    terminal.CONSOLE.print(f"{cuts} cuts: at most {max(lost_s):.3f} s lost after repair")
    terminal.CONSOLE.print(f"{flips} wrong bits: {len(unnoticed)} unnoticed {unnoticed[:5]}")
    terminal.CONSOLE.print(
        f"{mutations} mutated files: {verdict['read']} read, {verdict['refused']} refused with the"
        f" named error, {len(verdict['wrong'])} otherwise {verdict['wrong'][:5]}"  # type: ignore[arg-type, index]
    )
    write_json(json_file, figures)
    sys.exit(bool(max(lost_s) > _MOST_LOST_S or unnoticed or verdict["wrong"]))


def write_bag(path: Path, samples: int) -> Path:
    """Write state and command with the project's writer."""
    topics = [RecordedTopic(name, describe(typestore(), kind)) for name, kind in TYPES.items()]
    with BagWriter(path, topics) as bag:
        for topic, time_ns, raw in experiment(samples):
            bag.write(topic, raw, time_ns, time_ns)
    return path


def lost_by_cut(bag: Path, folder: Path, chance: random.Random) -> float:
    """Cut a copy at a random byte, repair it, and return the seconds lost of those on disk."""
    (file,) = bag.glob("*.mcap")
    raw = file.read_bytes()
    size = chance.randrange(len(raw))
    written_ns, first_ns = _written_until(file, size)
    cut, repaired = folder / "cut", folder / "repaired"
    for old in (cut, repaired):
        shutil.rmtree(old, ignore_errors=True)
    cut.mkdir()
    (cut / file.name).write_bytes(raw[:size])
    try:
        repair_bag(cut, repaired)
    except RecordingError:
        return (written_ns - first_ns) / 1e9
    found = check_bag(repaired)
    if found.problems:
        raise SystemExit(f"cut at byte {size}: the repaired bag has {found.problems}")
    (copy,) = repaired.glob("*.mcap")
    with copy.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None  # noqa: S101 - our own writer's
    assert summary.statistics is not None  # noqa: S101
    return max(0.0, (written_ns - summary.statistics.message_end_time) / 1e9)


def _written_until(file: Path, size: int) -> tuple[int, int]:
    """Return the last time that can have been written before a byte, and the first of all."""
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None  # noqa: S101 - our own writer's
    chunks = sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
    begun = [chunk.message_end_time for chunk in chunks if chunk.chunk_start_offset < size]
    return (begun or [chunks[0].message_start_time])[-1], chunks[0].message_start_time


def unnoticed_bit(bag: Path, chance: random.Random) -> str:
    """Turn one bit of a bag for a moment; return where when the check does not see it."""
    (file,) = bag.glob("*.mcap")
    position, bit = chance.randrange(file.stat().st_size), chance.randrange(8)
    _turn(file, position, bit)
    try:
        return "" if check_bag(bag).problems else f"byte {position} bit {bit}"
    finally:
        _turn(file, position, bit)


def _turn(file: Path, position: int, bit: int) -> None:
    with file.open("r+b") as stream:
        stream.seek(position)
        (value,) = stream.read(1)
        stream.seek(position)
        stream.write(bytes([value ^ (1 << bit)]))


def mutated(folder: Path, mutations: int, seed: int) -> dict[str, object]:
    """Read mutated files in a child under a memory limit; return its verdict."""
    bags = folder / "bags"
    write_bag(bags / "ours", 500)
    for name, storage in (("mcap", StoragePlugin.MCAP), ("sqlite", StoragePlugin.SQLITE3)):
        writer = Writer(bags / name, version=9, storage_plugin=storage)
        with writer:
            connections = {
                topic: writer.add_connection(topic, kind, typestore=typestore())
                for topic, kind in TYPES.items()
            }
            for topic, time_ns, raw in experiment(300):
                writer.write(connections[topic], time_ns, raw)
    (bags / "plain").mkdir()
    with (bags / "plain" / "plain.mcap").open("wb") as stream:
        plain = McapWriter(stream, compression=CompressionType.NONE, use_chunking=False)
        plain.start("ros2", "another writer")
        channels = {
            topic: plain.register_channel(
                topic,
                "cdr",
                plain.register_schema(kind, "ros2msg", describe(typestore(), kind).text.encode()),
            )
            for topic, kind in TYPES.items()
        }
        for topic, time_ns, raw in experiment(300):
            plain.add_message(channels[topic], time_ns, raw, time_ns)
        plain.finish()  # type: ignore[no-untyped-call]
    command = [
        sys.executable,
        "-m",
        "bench.bags.bag_faults",
        "--read",
        str(bags),
        "--mutations",
        str(mutations),
    ]
    done = subprocess.run(  # noqa: S603 - this module
        [*command, "--seed", str(seed)], check=False, capture_output=True, text=True
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no word"])[-1]
        return {"read": 0, "refused": 0, "wrong": [f"exit code {done.returncode}: {last}"]}
    answer: dict[str, object] = json.loads(done.stdout.splitlines()[-1])
    return answer


def read_mutated(bags: Path, mutations: int, seed: int) -> None:
    """Mutate one file of a bag at a time, read the bag, and print the verdict as JSON."""
    chance = random.Random(seed)  # noqa: S311 - chance, not secrecy
    targets = sorted(file for file in bags.rglob("*") if file.is_file())
    for bag in sorted(bags.iterdir()):
        read_bag(_readable(bag))
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    limit = pages * resource.getpagesize() + _MORE_MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    signal.signal(signal.SIGVTALRM, _hangs)
    verdict: dict[str, int] = {"read": 0, "refused": 0}
    wrong: list[str] = []
    for number in range(mutations):
        file, mutate = chance.choice(targets), chance.choice(MUTATIONS)
        whole = file.read_bytes()
        file.write_bytes(mutate(chance, whole))
        signal.setitimer(signal.ITIMER_VIRTUAL, _CPU_S)
        try:
            read_bag(_readable(file.parent))
            verdict["read"] += 1
        except BagError as error:
            verdict["refused"] += 1
            if "\n" in str(error):
                wrong.append(f"{number}: {file.name}: more than one line")
        except BaseException as error:  # noqa: BLE001 - that is what is looked for
            wrong.append(f"{number}: {mutate.__name__} {file.name}: {error!r}")
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
            file.write_bytes(whole)
    click.echo(json.dumps({**verdict, "wrong": wrong}))


def _readable(bag: Path) -> Path:
    return bag if (bag / "metadata.yaml").exists() else next(bag.glob("*.mcap"))


def _hangs(*_: object) -> None:
    raise TimeoutError(f"read for more than {_CPU_S:g} s")


def _bits(chance: random.Random, raw: bytes) -> bytes:
    changed = bytearray(raw)
    for _ in range(chance.choice((1, 1, 8))):
        changed[chance.randrange(len(raw))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def _number(chance: random.Random, raw: bytes) -> bytes:
    at, size = chance.randrange(len(raw)), chance.choice((2, 4, 8))
    value: int = chance.choice(_HUGE) % 2 ** (8 * size)
    return raw[:at] + value.to_bytes(size, "little") + raw[at + size :]


def _noise(chance: random.Random, raw: bytes) -> bytes:
    at = chance.randrange(len(raw))
    noise: bytes = chance.randbytes(chance.randrange(1, 200))
    return raw[:at] + noise + raw[at + len(noise) :]


def _zeros(chance: random.Random, raw: bytes) -> bytes:
    at, size = chance.randrange(len(raw)), chance.randrange(1, 5000)
    return raw[:at] + bytes(len(raw[at : at + size])) + raw[at + size :]


def _cut(chance: random.Random, raw: bytes) -> bytes:
    return raw[: chance.randrange(len(raw))]


def _gap(chance: random.Random, raw: bytes) -> bytes:
    at = chance.randrange(len(raw))
    return raw[:at] + raw[at + chance.randrange(1, 2000) :]


def _twice(chance: random.Random, raw: bytes) -> bytes:
    at = chance.randrange(len(raw))
    return raw[: at + chance.randrange(1, 2000)] + raw[at:]


MUTATIONS: tuple[Mutation, ...] = (_bits, _number, _noise, _zeros, _cut, _gap, _twice)


def _shown(steps: Iterable[int], what: str) -> Iterable[int]:
    return track(steps, what, transient=True, disable=not sys.stdout.isatty())


if __name__ == "__main__":
    main()

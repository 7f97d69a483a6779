from __future__ import annotations

import os
import resource
import sqlite3
import struct
import tempfile
from contextlib import closing
from typing import TYPE_CHECKING

import pytest
import zstandard
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from flexarm_bags.bounds import bounded
from flexarm_bags.check import check_bag
from flexarm_bags.playback import PlaybackError, PlaybackPlan
from flexarm_bags.reader import opened
from flexarm_bags.repair import repair_bag
from flexarm_bags.writer import RecordingError
from flexarm_core.bounds import READ_VARIABLE
from flexarm_core.errors import BagError
from support.bag_samples import FOREIGN_FORMATS, controlled_run, mcap_file, write_bag
from support.bag_samples import write_foreign_bag as write_foreign
from support.damaged_bags import CHUNK, Recording, content, damaged_copy
from support.exhaustive import first_of
from support.hostile_bags import (
    MB,
    STATE,
    Packed,
    lz4_zeros,
    record,
    write_chunks,
    write_packed_bag,
    zstd_zeros,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

# Each by a function, since zeros take time to pack, and whether the file has an index.
BOMBS: dict[str, tuple[Callable[[], Packed], bool]] = {
    "lz4 beyond its size": (lambda: Packed("lz4", lz4_zeros(500), 1000), True),
    "lz4 of an honest size": (lambda: Packed("lz4", lz4_zeros(300), 300 * MB), True),
    "lz4 without an index": (lambda: Packed("lz4", lz4_zeros(500), 1000), False),
    "zstd beyond its size": (lambda: Packed("zstd", zstd_zeros(500), 1000), True),
    "zstd in two frames": (lambda: Packed("zstd", zstd_zeros(0) + zstd_zeros(500), 1000), False),
    "zstd of 8 GB": (lambda: Packed("zstd", zstd_zeros(1, states_size=True), 8 << 30), True),
    "a size of 1 TB": (lambda: Packed("zstd", zstd_zeros(1), 1 << 40), True),
    "an unpacked size of 1 TB": (lambda: Packed("", bytes(1000), 1 << 40), False),
}


def read(bag: Path) -> None:
    with opened(bag) as found:
        found.recorded(STATE)


def played(bag: Path) -> None:
    list(PlaybackPlan(bag).messages())


def repaired(bag: Path) -> None:
    repair_bag(bag, bag.with_name("copy"))


def checked(bag: Path) -> None:
    found = check_bag(bag)
    assert found.problems
    raise BagError("; ".join(found.problems))


WAYS = [read, played, repaired, checked]


def refusal(bag: Path, way: Callable[[Path], None], most_mb: int = 200) -> str:
    """Return how a bag is refused, in little memory."""
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises((BagError, PlaybackError, RecordingError)) as caught:
        way(bag)
    taken_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
    assert taken_kb < most_mb << 10
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("bomb", BOMBS)
def test_bomb___is_refused_in_little_memory(
    tmp_path: Path, bomb: str, way: Callable[[Path], None]
) -> None:
    packed, indexed = BOMBS[bomb]
    refusal(write_chunks(tmp_path / "run.mcap", packed(), indexed=indexed), way)


@pytest.mark.parametrize("way", [read, played, checked])
def test_many_chunks_of_a_small_file___are_refused_unread(
    tmp_path: Path, way: Callable[[Path], None]
) -> None:
    packed = Packed("zstd", zstd_zeros(100), 100 * MB)
    file = write_chunks(tmp_path / "run.mcap", packed, chunks=500)
    said = refusal(file, way, most_mb=50)
    assert "unpacked it has more than 256 MB, which is a lot for its size" in said
    assert READ_VARIABLE in said


@pytest.mark.parametrize("way", first_of(WAYS, 2))
def test_millions_of_empty_messages_without_an_index___are_refused_unvisited(
    tmp_path: Path, way: Callable[[Path], None]
) -> None:
    empty = record(5, struct.pack("<HIQQ", 1, 0, 1, 1))
    content = empty * (60 * MB // len(empty))
    packed = Packed("zstd", zstandard.compress(content), len(content))
    said = refusal(write_chunks(tmp_path / "run.mcap", packed, indexed=False), way, most_mb=400)
    assert way is repaired or "a chunk holds more than 524288 records" in said


def test_chunks_within_a_larger_allowance___are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = write_bag(tmp_path / "run", controlled_run())
    monkeypatch.setattr("flexarm_core.bounds._RATIO", 0)
    monkeypatch.setenv(READ_VARIABLE, "1")
    read(bag)
    file = write_chunks(tmp_path / "b.mcap", Packed("zstd", zstd_zeros(1), MB), chunks=2)
    with pytest.raises(BagError, match="unpacked it has more than 1 MB"):
        read(file)
    monkeypatch.setenv(READ_VARIABLE, "2")
    with pytest.raises(BagError, match="a message does not fit into its chunk"):
        read(file)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ["run.mcap", "run.db3", "run/run_0.mcap", "run/metadata.yaml"])
def test_pipe_or_device___is_refused_unread(
    tmp_path: Path, name: str, way: Callable[[Path], None]
) -> None:
    if way is repaired and name in {"run.db3", "run/metadata.yaml"}:
        pytest.skip("only MCAP files are repaired, and their metadata are not needed")
    bag = tmp_path / name.partition("/")[0]
    file = tmp_path / name
    if "/" in name:
        write_bag(bag, controlled_run(5))
        file.unlink()
    os.mkfifo(file)
    assert "is not a plain file (a pipe, socket or device)" in refusal(bag, way)
    file.unlink()
    file.symlink_to("/dev/zero")
    assert "is not a plain file (a pipe, socket or device)" in refusal(bag, way)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ["run.mcap", "run.db3"])
def test_file_of_holes___is_refused(tmp_path: Path, name: str, way: Callable[[Path], None]) -> None:
    if way is repaired and name == "run.db3":
        pytest.skip("only MCAP files are repaired")
    file = tmp_path / name
    file.touch()
    os.truncate(file, 10 << 30)
    assert "10240 of its 10240 MB are holes" in refusal(file, way)


@pytest.mark.parametrize("way", [read, played, checked])
def test_file_compressed_as_a_whole___does_not_fill_the_temporary_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way: Callable[[Path], None]
) -> None:
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    bag = write_packed_bag(tmp_path / "run", zstd_zeros(500))
    monkeypatch.setenv(READ_VARIABLE, "10")
    assert "run_0.mcap.zstd: unpacked it has more than 10 MB" in refusal(bag, way)
    assert list(temporary.iterdir()) == []


def test_bomb_in_a_compressed_file___is_refused(tmp_path: Path) -> None:
    packed = Packed("lz4", lz4_zeros(300), 300 * MB)
    file = write_chunks(tmp_path / "run.mcap", packed, indexed=False)
    bag = write_packed_bag(tmp_path / "run", zstandard.compress(file.read_bytes()))
    assert "says that it has 300 MB unpacked, allowed are 128" in refusal(bag, read)


def test_damaged_compressed_file___is_one_line(tmp_path: Path) -> None:
    bag = write_packed_bag(tmp_path / "run", b"no frame")
    assert "run_0.mcap.zstd: cannot be decompressed: " in refusal(bag, read)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_compressed_messages_that_are_bombs___are_refused(
    tmp_path: Path, storage: StoragePlugin
) -> None:
    bag = write_foreign(tmp_path / "run", controlled_run(5), storage, CompressionMode.MESSAGE)
    if storage is StoragePlugin.SQLITE3:
        with closing(sqlite3.connect(next(bag.glob("*.db3")))) as database, database:
            database.execute("UPDATE messages SET data = ? WHERE id = 3", (zstd_zeros(500),))
    else:
        large = [each._replace(raw=bytes(300 * MB)) for each in controlled_run(1)[:1]]
        bag = write_foreign(tmp_path / "large", large, storage, CompressionMode.MESSAGE)
    assert "unpacked it has more than 256 MB" in refusal(bag, read, most_mb=1000)


@pytest.mark.parametrize(("storage", "compression"), FOREIGN_FORMATS)
def test_bag_of_another_writer___is_within_bounds(
    tmp_path: Path, storage: StoragePlugin, compression: CompressionMode
) -> None:
    messages = controlled_run(50)
    bag = write_foreign(tmp_path / "run", messages, storage, compression)
    with bounded(bag) as plain:
        assert content(plain) == content(bag)
    with opened(bag) as found:
        assert len(found.recorded(STATE)) == 50


def test_what_follows_the_footer___is_not_copied(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", controlled_run(20))
    with mcap_file(bag).open("ab") as file:
        for _ in range(300):
            file.write(b"x" * MB)
    assert "does not end as an MCAP file" in refusal(bag, checked, most_mb=100)
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert repair_bag(bag, tmp_path / "copy").messages == 41
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 100 << 10


def test_wrong_size_of_one_chunk___costs_a_repair_that_chunk_only(tmp_path: Path) -> None:
    recording = Recording(tmp_path / "run")
    raw = bytearray(recording.file.read_bytes())
    # The highest byte of the unpacked size, behind the start of the record and two times.
    raw[recording.chunks[1][0] + 9 + 16 + 7] = 1
    damaged = damaged_copy(recording, tmp_path / "damaged", bytes(raw))
    summary = repair_bag(damaged, tmp_path / "copy")
    assert (summary.messages, summary.lost) == (len(recording.messages) - CHUNK, CHUNK)


@pytest.mark.parametrize(
    ("in_chunk", "in_index"), [(300 * MB, MB), (MB, 300 * MB), (128 * MB + 1, MB)]
)
@pytest.mark.parametrize("way", [read, played, checked])
def test_chunk_and_its_index___of_different_sizes___the_larger_one_counts(
    tmp_path: Path, way: Callable[[Path], None], in_chunk: int, in_index: int
) -> None:
    file = write_chunks(tmp_path / "run.mcap", Packed("zstd", zstd_zeros(1), in_chunk))
    raw = file.read_bytes()
    # The size stands once in the chunk, and once at the end of its index.
    at = raw.rindex(struct.pack("<Q", in_chunk))
    file.write_bytes(raw[:at] + struct.pack("<Q", in_index) + raw[at + 8 :])
    largest = max(in_chunk, in_index) // MB
    said = f"says that it has {largest} MB unpacked, allowed are 128"
    assert said in refusal(file, way, most_mb=50)

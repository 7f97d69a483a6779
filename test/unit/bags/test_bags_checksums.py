"""Every kind of checksum of a bag, broken by itself and told by its name."""

from __future__ import annotations

import re
import struct
from io import BytesIO
from typing import TYPE_CHECKING
from zlib import crc32

import pytest
from mcap import records
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from flexarm_bags.check import check_bag
from flexarm_bags.records import layout
from flexarm_bags.records.layout import CutError, chunk_content, summary_of
from flexarm_core.bounds import BoundError
from support.damaged_bags import MAGIC, Recording, damaged_copy

if TYPE_CHECKING:
    from pathlib import Path

SUMMARY = "the summary does not have its checksum"
CHUNK_CRC_AT = 9 + 3 * 8
"""Behind the head of the record: two times and a size of 8 bytes each."""


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return Recording(tmp_path_factory.mktemp("checksums") / "run")


def summary_bytes(recording: Recording) -> list[int]:
    """Return positions all over the summary, the offsets at its end and the footer among them."""
    end = len(recording.file.read_bytes()) - len(MAGIC)
    inside = range(recording.summary_at, end, max(1, (end - recording.summary_at) // 25))
    return [*inside, *range(end - 60, end)]


def with_a_wrong_bit(recording: Recording, position: int) -> bytes:
    raw = bytearray(recording.file.read_bytes())
    raw[position] ^= 1
    return bytes(raw)


def test_whole_bag___has_nothing_wrong(recording: Recording) -> None:
    assert check_bag(recording.bag).problems == ()
    with recording.file.open("rb") as stream:
        assert summary_of(stream)


def test_summary___one_wrong_bit_anywhere___is_noticed_where_the_summary_is_read(
    recording: Recording, tmp_path: Path
) -> None:
    for position in summary_bytes(recording):
        file = tmp_path / "damaged.mcap"
        file.write_bytes(with_a_wrong_bit(recording, position))
        with file.open("rb") as stream, pytest.raises(ValueError, match=r"."):
            summary_of(stream)


@pytest.mark.parametrize("back", [1, 5, 12, 30])
def test_summary___wrong_bit_near_the_end_of_the_offsets___is_reported(
    recording: Recording, tmp_path: Path, back: int
) -> None:
    """Nothing but the checksum covers these bytes twice."""
    footer = len(recording.file.read_bytes()) - len(MAGIC) - 29
    raw = with_a_wrong_bit(recording, footer - back)
    found = check_bag(damaged_copy(recording, tmp_path / "copy", raw)).problems
    assert f"{recording.file.name}: {SUMMARY}" in found
    file = tmp_path / "copy" / recording.file.name
    with file.open("rb") as stream, pytest.raises(ValueError, match=f"^{SUMMARY}$"):
        summary_of(stream)


@pytest.mark.parametrize(
    ("place", "problem"),
    [
        ("summary", SUMMARY),
        ("data section", "the data section does not have its checksum"),
        ("chunk", "a chunk does not have its checksum"),
    ],
)
def test_checksum___changed_itself___is_reported(
    recording: Recording, tmp_path: Path, place: str, problem: str
) -> None:
    raw = recording.file.read_bytes()
    positions = {
        "summary": len(raw) - len(MAGIC) - 4,
        "data section": recording.summary_at - 4,
        "chunk": recording.chunks[0][0] + CHUNK_CRC_AT,
    }
    position = positions[place]
    assert struct.unpack_from("<I", raw, position) != (0,)
    damaged = damaged_copy(recording, tmp_path / "copy", with_a_wrong_bit(recording, position))
    assert any(found.endswith(f": {problem}") for found in check_bag(damaged).problems)


def test_checksums_left_out___are_reported_as_notes(recording: Recording, tmp_path: Path) -> None:
    raw = bytearray(recording.file.read_bytes())
    for position in (len(raw) - len(MAGIC) - 4, recording.summary_at - 4):
        raw[position : position + 4] = bytes(4)
    found = check_bag(damaged_copy(recording, tmp_path / "copy", bytes(raw)))
    name = recording.file.name
    assert f"{name}: has no checksum over its summary" in found.notes
    assert (
        f"{name}: has no checksum over its data section, only what its chunks have" in found.notes
    )


@pytest.mark.parametrize(("start", "is_reported"), [(1, True), (0, False)])
def test_footer___that_points_elsewhere___is_reported(
    recording: Recording,
    tmp_path: Path,
    start: int,
    is_reported: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    raw = bytearray(recording.file.read_bytes())
    footer = len(raw) - len(MAGIC) - 20
    struct.pack_into("<Q", raw, footer, start)
    struct.pack_into("<I", raw, footer + 16, crc32(raw[recording.summary_at : footer + 16]))
    found = check_bag(damaged_copy(recording, tmp_path / "copy", bytes(raw))).problems
    line = f"{recording.file.name}: the footer does not point at the summary"
    assert (line in found) is is_reported


def file_end(start: int = 0, opcode: int = Opcode.FOOTER, magic: bytes = MAGIC) -> bytes:
    """Return footer and magic of a file without a checksum over its summary."""
    return struct.pack("<BQQQI", opcode, 20, start, 0, 0) + magic


def test_summary___of_a_whole_bag___is_its_records(recording: Recording) -> None:
    with recording.file.open("rb") as stream:
        kinds = {type(record) for record in summary_of(stream)}
    assert {records.Statistics, records.Schema, records.Channel, records.ChunkIndex} <= kinds


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "the file is cut"),
        (file_end()[1:], "the file is cut"),
        (file_end(opcode=Opcode.DATA_END), "the file does not end as an MCAP file"),
        (file_end(magic=b"another!"), "the file does not end as an MCAP file"),
        (file_end(start=1000), "the file does not end as an MCAP file"),
    ],
)
def test_summary___of_a_damaged_end___is_refused(content: bytes, complaint: str) -> None:
    with pytest.raises(CutError, match=f"^{complaint}$"):
        summary_of(BytesIO(content))


def test_summary___that_is_not_there___is_empty() -> None:
    assert summary_of(BytesIO(file_end())) == []


@pytest.mark.parametrize(("more", "is_refused"), [(0, False), (1, True)])
def test_summary___of_most_of_a_large_file___is_refused(
    monkeypatch: pytest.MonkeyPatch,
    more: int,
    is_refused: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    monkeypatch.setattr(layout, "_SUMMARY_BYTES", 1 << 20)
    monkeypatch.setattr(layout, "_SUMMARY_PART", 4)
    size = 4 << 20
    end = file_end(start=size - (2 << 20) - more)
    said = ""
    try:
        summary_of(BytesIO(bytes(size - len(end)) + end))
    except (ValueError, BoundError) as error:
        said = str(error)
    assert (said == "a summary of 2 of 4 MB is not a summary") is is_refused


def chunk(data: bytes, size: int, checksum: int) -> records.Chunk:
    return records.Chunk(
        compression="",
        data=data,
        message_start_time=0,
        message_end_time=0,
        uncompressed_crc=checksum,
        uncompressed_size=size,
    )


@pytest.mark.parametrize("checksum", [crc32(b"content"), 0])
def test_chunk___with_its_checksum_or_none___is_its_bytes(checksum: int) -> None:
    assert chunk_content(chunk(b"content", 7, checksum)).tobytes() == b"content"


@pytest.mark.parametrize(
    ("made", "complaint"),
    [
        (chunk(b"content", 7, 1), "a chunk does not have its checksum"),
        (chunk(b"content", 8, 0), "a chunk of 8 bytes has 7"),
        (chunk(b"", (6 << 20) + 1, 0), "a chunk of 6 MB, allowed are 6"),
    ],
)
def test_chunk___that_is_damaged___is_refused(
    monkeypatch: pytest.MonkeyPatch, made: records.Chunk, complaint: str
) -> None:
    monkeypatch.setattr(layout, "CHUNK_BYTES", 6 << 20)
    with pytest.raises(ValueError, match=f"^{complaint}$"):
        chunk_content(made)


def test_chunk___of_the_largest_size___is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(layout, "CHUNK_BYTES", 1 << 10)
    assert len(chunk_content(chunk(bytes(1 << 10), 1 << 10, 0))) == 1 << 10


def test_attachment___with_a_wrong_bit___is_reported(tmp_path: Path) -> None:
    good, bad = tmp_path / "good.mcap", tmp_path / "bad.mcap"
    content = b"a picture of the rig"
    with good.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start("ros2", "another writer")
        writer.add_attachment(1, 1, "rig.png", "image/png", content)
        writer.finish()  # type: ignore[no-untyped-call]
    assert not any("attachment" in problem for problem in check_bag(good).problems)
    raw = bytearray(good.read_bytes())
    raw[raw.index(content)] ^= 1
    bad.write_bytes(raw)
    said = re.compile(r"bad\.mcap: the attachment at byte \d+ does not have its checksum")
    assert any(said.fullmatch(problem) for problem in check_bag(bad).problems)

"""Every kind of checksum of a bag, broken by itself and told by its name."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import pytest

from flexarm_bags.check import check_bag
from flexarm_bags.records.layout import summary_of
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
def test_summary___wrong_bit_near_the_end_of_the_offsets___is_told(
    recording: Recording, tmp_path: Path, back: int
) -> None:
    """Nothing but the checksum covers these bytes twice."""
    footer = len(recording.file.read_bytes()) - len(MAGIC) - 29
    raw = with_a_wrong_bit(recording, footer - back)
    found = check_bag(damaged_copy(recording, tmp_path / "copy", raw)).problems
    assert any(SUMMARY in problem for problem in found)
    file = tmp_path / "copy" / recording.file.name
    with file.open("rb") as stream, pytest.raises(ValueError, match=SUMMARY):
        summary_of(stream)


@pytest.mark.parametrize(
    ("place", "problem"),
    [
        ("summary", SUMMARY),
        ("data section", "the data section does not have its checksum"),
        ("chunk", "a chunk does not have its checksum"),
    ],
)
def test_checksum___changed_itself___is_told(
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
    assert any(problem in found for found in check_bag(damaged).problems)

"""Repair of files whose end cuts a chunk, as recorders other than ours write large ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType

from flexarm_bags.repair import repair_bag
from flexarm_bags.writer import RecordingError
from support.bag_samples import Sent, experiment, mcap_file
from support.damaged_bags import chunks_of, content_of_file
from support.ros2_bags import RECEIVED_NS, Layout, write_ros2_bag

if TYPE_CHECKING:
    from pathlib import Path

MESSAGES = experiment(200)
LONG = experiment(3000)
"""More than a block of zstd, 128 KB."""


def received(messages: list[Sent]) -> list[Sent]:
    """Return messages with the times at which the recorder got them."""
    return [each._replace(time_ns=each.time_ns + RECEIVED_NS) for each in messages]


def one_chunk(folder: Path, messages: list[Sent], compression: CompressionType) -> bytes:
    """Return a file whose messages are in one chunk."""
    layout = Layout(compression=compression, checksums=False)
    raw = mcap_file(write_ros2_bag(folder / "run", messages, layout)).read_bytes()
    assert len(chunks_of(raw)) == 1
    return raw


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return one_chunk(tmp_path_factory.mktemp("plain"), MESSAGES, CompressionType.NONE)


def ends_of(raw: bytes, messages: list[Sent]) -> list[int]:
    """Return where each message ends in a file, found by its own bytes."""
    ends, at = [], 0
    for message in messages:
        at = raw.index(message.raw, at) + len(message.raw)
        ends.append(at)
    return ends


@settings(max_examples=40)
@given(st.data())
def test_plain_chunk_cut_anywhere___its_whole_messages_are_saved(
    tmp_path_factory: pytest.TempPathFactory, plain: bytes, data: st.DataObject
) -> None:
    _, end = chunks_of(plain)[0]
    size = data.draw(st.integers(0, end - 1))
    folder = tmp_path_factory.mktemp("cut")
    (folder / "run.mcap").write_bytes(plain[:size])
    whole = sum(end <= size for end in ends_of(plain, MESSAGES))
    if whole == 0:
        with pytest.raises(RecordingError, match="has no whole message"):
            repair_bag(folder / "run.mcap", folder / "copy")
        return
    summary = repair_bag(folder / "run.mcap", folder / "copy")
    assert content_of_file(folder / "copy") == received(MESSAGES[:whole])
    assert summary.lost is None
    assert summary.damage == (
        "run.mcap: it ends in the middle",
        f"run.mcap: its last chunk is cut: the first messages of it, {whole}, are unchecked",
    )


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_compressed_chunk_that_is_cut___gives_the_blocks_that_are_whole(
    tmp_path: Path, compression: CompressionType
) -> None:
    raw = one_chunk(tmp_path, LONG, compression)
    start, end = chunks_of(raw)[0]
    (tmp_path / "run.mcap").write_bytes(raw[: start + (end - start) * 9 // 10])
    repair_bag(tmp_path / "run.mcap", tmp_path / "copy")
    saved = content_of_file(tmp_path / "copy")
    # The reader gives them by their times.
    assert sorted(saved) == sorted(received(LONG[: len(saved)]))
    assert len(saved) > len(LONG) // 3


def test_length_that_is_wrong___makes_no_cut_chunk(plain: bytes, tmp_path: Path) -> None:
    start, _ = chunks_of(plain)[0]
    raw = bytearray(plain[:-1])
    raw[start + 4] ^= 0x40
    (tmp_path / "run.mcap").write_bytes(raw)
    with pytest.raises(RecordingError, match="has no whole message"):
        repair_bag(tmp_path / "run.mcap", tmp_path / "copy")

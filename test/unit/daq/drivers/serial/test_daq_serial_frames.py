from __future__ import annotations

from binascii import crc_hqx
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_daq.drivers.serial.messages import FrameReader, board_sample, command, framed, greeting

if TYPE_CHECKING:
    from numpy.typing import NDArray

CONTENTS = st.binary(min_size=1, max_size=600)
SAMPLES = 10_000


def plain(coded: bytes) -> bytes:
    """Undo COBS by its definition: each code byte is the distance to the next zero."""
    content, at, code = b"", 0, 0xFF
    while at < len(coded):
        code = coded[at]
        content += coded[at + 1 : at + code] + (b"\0" if code < 0xFF else b"")
        at += code
    return content if code == 0xFF else content[:-1]


@given(CONTENTS)
def test_frame___has_one_zero_at_its_end_and_a_check_behind_its_content(content: bytes) -> None:
    frame = framed(content)
    assert frame.count(b"\0") == 1
    assert frame.endswith(b"\0")
    checked = plain(frame[:-1])
    assert checked[:-2] == content
    # The check of a message with its own check behind it, high byte first, is zero.
    assert crc_hqx(content + checked[-2:][::-1], 0xFFFF) == 0
    assert list(FrameReader().feed(frame)) == [content]


def test_frame___known_ones___are_as_published() -> None:
    # CRC-16/CCITT-FALSE of "123456789" is 0x29B1.
    assert framed(b"123456789") == b"\x0c123456789\xb1\x29\0"
    assert framed(b"\0") == b"\x01\x03" + crc_hqx(b"\0", 0xFFFF).to_bytes(2, "little") + b"\0"


@given(st.lists(CONTENTS, max_size=8), st.lists(st.integers(1, 40), min_size=1, max_size=50))
def test_reader___frames_in_any_pieces___come_whole(contents: list[bytes], cuts: list[int]) -> None:
    line = b"".join(map(framed, contents))
    reader, at = FrameReader(), 0
    found: list[bytes] = []
    for cut in cuts:
        found += reader.feed(line[at : at + cut])
        at += cut
    found += reader.feed(line[at:])
    assert (found, reader.damaged) == (contents, 0)


@given(st.binary(max_size=2000), CONTENTS)
def test_reader___garbage_before_a_frame___costs_no_frame_after_its_end(
    garbage: bytes, content: bytes
) -> None:
    reader = FrameReader()
    assert list(reader.feed(garbage + b"\0" + framed(content)))[-1] == content


def test_reader___line_that_never_ends_a_frame___keeps_little() -> None:
    reader = FrameReader()
    for _ in range(100):
        assert list(reader.feed(b"\x01" * 1000)) == []
    assert len(reader._begun) <= 512


@given(st.integers(1, 3), st.data())
def test_reader___up_to_three_flipped_bits_in_a_content___are_found(
    flips: int, data: st.DataObject
) -> None:
    """The check has a distance of 4 for contents of up to 32,751 bits (Koopman's tables)."""
    content = data.draw(st.binary(min_size=4, max_size=60))
    checked = bytearray(content + crc_hqx(content, 0xFFFF).to_bytes(2, "little"))
    places = st.integers(0, 8 * len(checked) - 1)
    for bit in data.draw(st.lists(places, min_size=flips, max_size=flips, unique=True)):
        checked[bit // 8] ^= 1 << bit % 8
    coded = b"".join(bytes([len(part) + 1]) + part for part in bytes(checked).split(b"\0"))
    reader = FrameReader()
    assert list(reader.feed(coded + b"\0")) == []
    assert reader.damaged == 1


def sample_content(sequence: int, rng: np.random.Generator) -> bytes:
    body = rng.integers(0, 256, 18, dtype=np.uint8).tobytes()
    return b"\x82" + (sequence % 65536).to_bytes(2, "little") + bytes(body) + b"\0" * 5


def flipped(line: bytes, part: float, rng: np.random.Generator) -> bytes:
    """Flip each bit with a probability."""
    bits: NDArray[np.uint8] = np.unpackbits(np.frombuffer(line, np.uint8))
    return np.packbits(bits ^ (rng.random(len(bits)) < part)).tobytes()


@pytest.mark.parametrize("part", [0.05, 0.01, 0.001])
def test_line___with_flipped_bits___gives_right_samples_alone_and_counts_the_rest(
    part: float,
) -> None:
    rng = np.random.default_rng(round(1e4 * part))
    contents = [sample_content(k, rng) for k in range(SAMPLES)]
    reader = FrameReader()
    line = flipped(b"".join(map(framed, contents)), part, rng)
    whole_frames = list(reader.feed(line))
    found = [sample for each in whole_frames if (sample := board_sample(each, 1, 3))]
    expected = [board_sample(content, 1, 3) for content in contents]
    known = dict(enumerate(expected))
    assert [each for each in found if known[each.sequence] != each] == []
    # Some 26 bytes of 8 bits: what comes whole is the power of one bit.
    whole = (1.0 - part) ** (8 * len(framed(contents[0])))
    assert len(found) == pytest.approx(SAMPLES * whole, rel=0.1, abs=5.0)
    sequences = [each.sequence for each in found]
    assert sequences == sorted(set(sequences))
    pieces = [each for each in line.split(b"\0")[:-1] if each]
    assert reader.damaged == len(pieces) - len(whole_frames)


def test_line___with_five_of_a_hundred_frames_hit___counts_them_exactly() -> None:
    rng = np.random.default_rng(5)
    hit = set(rng.choice(SAMPLES, SAMPLES // 20, replace=False).tolist())
    reader = FrameReader()
    found: list[int] = []
    for k in range(SAMPLES):
        frame = bytearray(framed(sample_content(k, rng)))
        if k in hit:
            place = int(rng.integers(0, len(frame) - 1))
            frame[place] ^= 1 << int(rng.integers(0, 8))
        found += [int.from_bytes(each[1:3], "little") for each in reader.feed(bytes(frame))]
    assert found == sorted(set(range(SAMPLES)) - hit)


@given(st.binary(max_size=100))
def test_messages___of_any_content___are_read_or_none(content: bytes) -> None:
    for reported in (b"\x81\x01" + content, b"\x82" + content):
        if (found := greeting(reported)) is not None:
            assert found.version == 1
        if (sample := board_sample(reported, 2, 4)) is not None:
            assert (len(sample.applied), len(sample.raw)) == (2, 4)


def test_greeting___of_another_version___has_that_alone() -> None:
    found = greeting(b"\x81\x07what it says is not known")
    assert found is not None
    assert (found.version, found.inputs) == (7, ())


def test_command___carries___the_sample_that_it_answers_and_counts() -> None:
    (content,) = FrameReader().feed(command(0x0201, [-2, 300]))
    assert content == b"\x03\x01\x02\xfe\xff\x2c\x01"

"""Messages between host and board, and the frames that carry them.

`docs/serial_protocol.md` has their layout. All numbers have their low byte first.

The coding of a frame is COBS [1]_, the check CRC-16 with the polynomial 0x1021 from 0xFFFF, low
byte first.

References
----------
.. [1] Cheshire, S., Baker, M. (1999). Consistent overhead byte stuffing. IEEE/ACM Transactions on
   Networking 7(2).
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

VERSION: Final = 1
_HELLO, _START, _COMMAND, _STOP = 0x01, 0x02, 0x03, 0x04
_GREETING, _SAMPLE = 0x81, 0x82
_STOPPED, _DRIVEN = 0x01, 0x02
_HEAD: Final = struct.Struct("<BHIBBBH")
_READINGS: Final = ("counter", "converter")
_CRC_START: Final = 0xFFFF
_CRC_BYTES: Final = 2
_LONGEST_BLOCK: Final = 254
_LONGEST_CODED: Final = 512
"""More bytes without a zero are not a frame."""


class BoardInput(NamedTuple):
    """Input of a board.

    Attributes
    ----------
    name : str
        Its name.
    limit : int
        Largest command, counts.
    slew_per_ms : int
        Fastest change, counts a millisecond.
    """

    name: str
    limit: int
    slew_per_ms: int


class BoardOutput(NamedTuple):
    """Output of a board.

    Attributes
    ----------
    name : str
        Its name.
    reading : str
        ``counter`` of an encoder or ``converter`` of a voltage.
    low, high : int
        Ends of its range, counts.
    """

    name: str
    reading: str
    low: int
    high: int


@dataclass(frozen=True)
class Greeting:
    """What a board says of itself.

    Attributes
    ----------
    version : int
        Version of the protocol.
    board : str
        Kind of the board; empty, as all that follows, in another version.
    shortest_period_us, watchdog_ms : int
        Shortest period of sampling, and silence after which its output is zero.
    inputs : tuple of BoardInput
        Its inputs.
    outputs : tuple of BoardOutput
        Its outputs.
    """

    version: int
    board: str = ""
    shortest_period_us: int = 0
    watchdog_ms: int = 0
    inputs: tuple[BoardInput, ...] = ()
    outputs: tuple[BoardOutput, ...] = ()


class BoardSample(NamedTuple):
    """Sample of a board.

    Attributes
    ----------
    sequence : int
        Number of the sample, modulo 65536.
    time_us : int
        Instant by the board's clock, modulo 2**32, microseconds.
    is_stopped, is_driven : bool
        Whether its stop is latched, and whether a command is in force.
    silences, damaged : int
        Times that its watchdog has put the output at zero, and frames that it could not read, both
        modulo 256.
    answered : int
        Sample that the command in force answers.
    applied : tuple of int
        Outputs of the drives, counts.
    raw : tuple of int
        Readings, counts.
    """

    sequence: int
    time_us: int
    is_stopped: bool
    is_driven: bool
    silences: int
    damaged: int
    answered: int
    applied: tuple[int, ...]
    raw: tuple[int, ...]


def hello() -> bytes:
    """Return the frame that asks for the greeting."""
    return framed(bytes([_HELLO]))


def start(period_us: int) -> bytes:
    """Return the frame that starts the sampling, with the output at zero."""
    return framed(struct.pack("<BI", _START, period_us))


def command(answers: int, counts: Sequence[int]) -> bytes:
    """Return the frame of a command, with the sequence of the sample that it answers."""
    return framed(struct.pack(f"<BH{len(counts)}h", _COMMAND, answers, *counts))


def stop() -> bytes:
    """Return the frame that ends the sampling, with the output at zero until the next start."""
    return framed(bytes([_STOP]))


def greeting(content: bytes) -> Greeting | None:
    """Return the greeting of a frame; None when it is none."""
    if len(content) <= 1 or content[0] != _GREETING:
        return None
    version = content[1]
    if version != VERSION:
        return Greeting(version)
    try:
        return _greeting(content)
    except (struct.error, IndexError, UnicodeDecodeError):
        return None


def _greeting(content: bytes) -> Greeting | None:
    board, at = _text(content, 2)
    shortest_us, watchdog_ms, inputs, outputs = struct.unpack_from("<IHBB", content, at)
    at += 8
    found_inputs, found_outputs = [], []
    for _ in range(inputs):
        limit, slew = struct.unpack_from("<hh", content, at)
        name, at = _text(content, at + 4)
        found_inputs.append(BoardInput(name, limit, slew))
    for _ in range(outputs):
        kind, low, high = struct.unpack_from("<Bii", content, at)
        name, at = _text(content, at + 9)
        found_outputs.append(BoardOutput(name, _READINGS[kind], low, high))
    if at != len(content):
        return None
    return Greeting(
        VERSION, board, shortest_us, watchdog_ms, tuple(found_inputs), tuple(found_outputs)
    )


def _text(content: bytes, at: int) -> tuple[str, int]:
    end = at + 1 + content[at]
    if end > len(content):
        raise IndexError
    return content[at + 1 : end].decode("ascii"), end


def board_sample(content: bytes, inputs: int, outputs: int) -> BoardSample | None:
    """Return the sample of a frame from a board of so many channels; None when it is none."""
    if content[0] != _SAMPLE or len(content) != _HEAD.size + 2 * inputs + 4 * outputs:
        return None
    _, sequence, time_us, status, silences, damaged, answered = _HEAD.unpack_from(content)
    values = struct.unpack_from(f"<{inputs}h{outputs}i", content, _HEAD.size)
    return BoardSample(
        sequence,
        time_us,
        bool(status & _STOPPED),
        bool(status & _DRIVEN),
        silences,
        damaged,
        answered,
        values[:inputs],
        values[inputs:],
    )


def framed(content: bytes) -> bytes:
    """Return the bytes on the line for a content that is not empty."""
    checked = content + crc_hqx(content, _CRC_START).to_bytes(_CRC_BYTES, "little")
    coded = bytearray()
    for block in checked.split(b"\0"):
        whole, rest = divmod(len(block), _LONGEST_BLOCK)
        for part in range(whole):
            coded += b"\xff" + block[part * _LONGEST_BLOCK : (part + 1) * _LONGEST_BLOCK]
        coded += bytes([rest + 1]) + block[whole * _LONGEST_BLOCK :]
    return bytes(coded) + b"\0"


def _uncoded(coded: bytes) -> bytes | None:
    content = bytearray()
    at = 0
    while at < len(coded):
        code = coded[at]
        block = coded[at + 1 : at + code]
        if len(block) != code - 1:
            return None
        content += block
        at += code
        if code <= _LONGEST_BLOCK and at < len(coded):
            content.append(0)
    return bytes(content)


class FrameReader:
    """Frames out of the bytes of a line, as they come.

    Attributes
    ----------
    damaged : int
        Pieces between two zeros that were no frame.
    """

    def __init__(self) -> None:
        self.damaged = 0
        self._begun = bytearray()

    def feed(self, received: bytes) -> Iterator[bytes]:
        """Yield the content of each frame that bytes complete."""
        self._begun += received
        *whole, rest = self._begun.split(b"\0")
        # A line that never ends a frame must not fill the memory.
        self._begun = rest[-_LONGEST_CODED:]
        for coded in whole:
            if not coded:
                continue
            content = _uncoded(bytes(coded))
            if content is None or len(content) <= _CRC_BYTES or not _is_sound(content):
                self.damaged += 1
            else:
                yield content[:-_CRC_BYTES]


def _is_sound(checked: bytes) -> bool:
    content, check = checked[:-_CRC_BYTES], checked[-_CRC_BYTES:]
    return crc_hqx(content, _CRC_START) == int.from_bytes(check, "little")

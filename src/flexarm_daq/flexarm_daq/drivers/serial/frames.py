"""Frames on a serial line: content with a check, coded so that a zero byte ends each.

The coding is COBS [1]_, the check CRC-16 with the polynomial 0x1021 from 0xFFFF, low byte first.

References
----------
.. [1] Cheshire, S., Baker, M. (1999). Consistent overhead byte stuffing. IEEE/ACM Transactions on
   Networking 7(2).
"""

from __future__ import annotations

from binascii import crc_hqx
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator

_CRC_START: Final = 0xFFFF
_CRC_BYTES: Final = 2
_LONGEST_BLOCK: Final = 254
_LONGEST_CODED: Final = 512
"""More bytes without a zero are not a frame."""


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

"""Fields of serialised messages, read without our own code."""

from __future__ import annotations

import struct


def stamp_of(raw: bytes) -> int:
    """Return the stamp of a message that begins with a header, ns since the epoch."""
    seconds, nanoseconds = struct.unpack_from("<iI", raw, 4)
    return int(seconds) * 10**9 + int(nanoseconds)

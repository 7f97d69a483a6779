"""Message stamps in whole nanoseconds: a float cannot hold seconds since 1970 to the nanosecond."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time

_NS = 1_000_000_000


def stamp_ns(stamp: Time) -> int:
    """Return a stamp as nanoseconds since the epoch."""
    return int(stamp.sec) * _NS + int(stamp.nanosec)


def stamp_text(stamp: Time) -> str:
    """Return a stamp as seconds since the epoch, to the nanosecond."""
    return f"{stamp.sec}.{stamp.nanosec:09d}"


def set_stamp(stamp: Time, time_ns: int) -> None:
    """Set a stamp to an instant in nanoseconds since the epoch."""
    stamp.sec, stamp.nanosec = divmod(time_ns, _NS)

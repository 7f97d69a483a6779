"""Message stamps in whole nanoseconds: a float cannot hold seconds since 1970 to the nanosecond."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time

_NS = 1_000_000_000


def stamp_ns(stamp: Time) -> int:
    """Return a stamp as nanoseconds since the epoch."""
    return joined_ns(stamp.sec, stamp.nanosec)


def joined_ns(sec: int, nanosec: int) -> int:
    """Return the members of a stamp as nanoseconds since the epoch."""
    return sec * _NS + nanosec


def stamp_members(time_ns: int) -> tuple[int, int]:
    """Return the members of a stamp, `sec` and `nanosec`."""
    return divmod(time_ns, _NS)


def stamp_text(time_ns: int) -> str:
    """Return an instant as seconds since the epoch, to the nanosecond."""
    sec, nanosec = stamp_members(time_ns)
    return f"{sec}.{nanosec:09d}"


def set_stamp(stamp: Time, time_ns: int) -> None:
    """Set a stamp to an instant in nanoseconds since the epoch."""
    stamp.sec, stamp.nanosec = stamp_members(time_ns)

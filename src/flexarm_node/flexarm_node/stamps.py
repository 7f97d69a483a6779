"""Message stamps in whole nanoseconds, which a float cannot hold, and a node's time for them."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from builtin_interfaces.msg import Time
    from rclpy.node import Node

_NS = 1_000_000_000
# Longer than discovery takes.
_PATIENCE_S = 5.0
_READINGS = 5


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


def beside_steady_clock(now_ns: Callable[[], int]) -> tuple[int, float]:
    """Return a clock (ns) and the steady clock (s) at one instant.

    A process may be interrupted between two clocks: of several readings the quickest counts.
    """
    width_s = math.inf
    instant = (0, 0.0)
    for _ in range(_READINGS):
        before_s = time.monotonic()
        time_ns = now_ns()
        after_s = time.monotonic()
        if after_s - before_s < width_s:
            width_s = after_s - before_s
            instant = (time_ns, 0.5 * (before_s + after_s))
    return instant


class NodeTime:
    """Clock of a node; with `use_sim_time` and no `/clock` it is the wall clock, and says so once.

    Parameters
    ----------
    node : Node
        The node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._missed_s = math.inf
        self._warned = False

    def now_ns(self) -> int:
        """Return the time in nanoseconds since the epoch, or since the simulated clock's start."""
        clock = self._node.get_clock()
        if not clock.ros_time_is_active:
            # The same clock, without the objects around it.
            return time.time_ns()
        now_ns: int = clock.now().nanoseconds
        if now_ns:
            return now_ns
        self._miss()
        return time.time_ns()

    def _miss(self) -> None:
        now_s = time.monotonic()
        self._missed_s = min(self._missed_s, now_s)
        if now_s - self._missed_s > _PATIENCE_S and not self._warned:
            self._warned = True
            self._node.get_logger().warning(
                "use_sim_time is set and nobody publishes /clock: stamps are the wall clock's"
            )

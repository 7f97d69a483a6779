"""Virtual time with a queue of events, and links that delay, reorder, drop and double messages."""

from __future__ import annotations

from heapq import heappop, heappush
from random import Random
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Sized

    from bench.schedules.schedule import Event

_EPOCH_NS = 1_700_000_000_000_000_000


class World:
    """Clock of all processes; it moves only when somebody waits.

    Attributes
    ----------
    now_s : float
        Steady time, s.
    wall_ahead_ns : int
        Jumps of the wall clock so far.
    """

    def __init__(self) -> None:
        self.now_s = 0.0
        self.wall_ahead_ns = 0
        self._queue: list[tuple[float, int, Callable[..., object], tuple[Any, ...]]] = []
        self._count = 0

    def monotonic(self) -> float:
        """Return the steady time, s."""
        return self.now_s

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        self.advance(self.now_s + seconds)

    def monotonic_ns(self) -> int:
        """Return the steady time, ns."""
        return round(self.now_s * 1e9)

    def wall_ns(self) -> int:
        """Return the wall clock's time, ns since the epoch."""
        return _EPOCH_NS + self.wall_ahead_ns + round(self.now_s * 1e9)

    def at(self, time_s: float, act: Callable[..., object], *arguments: object) -> None:
        """Let something happen at an instant; what is due at the same one keeps its order."""
        self._count += 1
        heappush(self._queue, (time_s, self._count, act, arguments))

    def advance(self, until_s: float, awaited: Sized = ()) -> None:
        """Let time pass until an instant, or until something that is awaited is there."""
        queue = self._queue
        while not awaited and queue and queue[0][0] <= until_s:
            time_s, _, act, arguments = heappop(queue)
            self.now_s = max(self.now_s, time_s)
            act(*arguments)
        if not awaited:
            self.now_s = max(self.now_s, until_s)


class Link:
    """Way of messages from one process to another: in order and without loss, but for its faults.

    Parameters
    ----------
    world : World
        Its time.
    seed : int or str
        Seed of the delays.
    deliver : callable
        Called with each message when it arrives.
    """

    def __init__(self, world: World, seed: str, deliver: Callable[..., None]) -> None:
        self._world = world
        self._random = Random(seed)  # noqa: S311 - not for secrets
        self._deliver = deliver
        self._last_s = 0.0
        self._count = 0
        self._faults: list[Event] = []

    def send(self, *message: object) -> None:
        """Send a message."""
        at_s = self._world.now_s + 2e-4 + 4e-4 * self._random.random()
        if self._faults:
            self._send_with_faults(at_s, message)
            return
        self._last_s = max(self._last_s, at_s)
        self._world.at(self._last_s, self._deliver, *message)

    def fail(self, fault: Event) -> None:
        """Begin a fault, which ends by itself."""
        self._faults.append(fault)
        self._world.at(self._world.now_s + fault.length_s, self._faults.remove, fault)

    def _send_with_faults(self, at_s: float, message: tuple[object, ...]) -> None:
        self._count += 1
        in_order = True
        for fault in self._faults:
            if fault.kind == "drop" and self._random.random() < fault.value:
                return
            if fault.kind == "delay":
                at_s += fault.value
            if fault.kind == "reorder" and self._count % 2:
                at_s, in_order = at_s + fault.value, False
            if fault.kind == "duplicate":
                self._world.at(at_s + fault.value, self._deliver, *message)
        if in_order:
            at_s = self._last_s = max(self._last_s, at_s)
        self._world.at(at_s, self._deliver, *message)

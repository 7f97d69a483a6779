"""Dead man's switch: a law that hangs in the sampling thread must not drive the arm on."""

from __future__ import annotations

import ctypes
import math
import os
import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

# Work that takes too long is noticed so much later at most.
_SLACK_S = 5e-3
_POLL_S = 1e-2
_REPORT_S = 1.0
_END_S = 1.0
_CLOCK_MONOTONIC = 1
_TFD_CLOEXEC = 0o2000000
_BYTES = 8
_NS = 1_000_000_000


class _TimerSpec(ctypes.Structure):
    """The struct itimerspec: interval and time left, each in seconds and nanoseconds."""

    _fields_ = (
        ("interval_s", ctypes.c_long),
        ("interval_ns", ctypes.c_long),
        ("left_s", ctypes.c_long),
        ("left_ns", ctypes.c_long),
    )


class KernelTimer:
    """Timer of the Linux kernel (timerfd) that goes off once, on the monotonic clock.

    A thread that polls takes the interpreter's lock at each turn, and a loop that is at work then
    has to give it up and wait for it: at 2 kHz a poll of every 10 ms makes one sample in twenty
    late.

    Raises
    ------
    OSError
        When the kernel has no timer to give.
    """

    def __init__(self) -> None:
        # It keeps the interpreter's lock in a call, which takes one microsecond.
        self._library = ctypes.PyDLL(None, use_errno=True)
        self._file = self._library.timerfd_create(_CLOCK_MONOTONIC, _TFD_CLOEXEC)
        if self._file < 0:
            number = ctypes.get_errno()
            raise OSError(number, os.strerror(number))

    def set(self, after_s: float) -> None:
        """Let it go off after some time from now, s, which takes the place of a former one."""
        left_s, left_ns = divmod(max(1, round(after_s * _NS)), _NS)
        spec = _TimerSpec(0, 0, left_s, left_ns)
        self._library.timerfd_settime(self._file, 0, ctypes.byref(spec), None)

    def wait(self) -> None:
        """Wait until it has gone off, without the interpreter's lock."""
        os.read(self._file, _BYTES)

    def close(self) -> None:
        """Give it back. No thread may be waiting any more."""
        os.close(self._file)


class Deadman:
    """Second thread that takes the drive to zero while work outside the rig holds up the sampling.

    That is an answer of the law, what follows it, and reports. The second thread sleeps until such
    work has taken too long, by 5 ms at most. The sampling thread is never in the rig at the same
    time: the two share a lock, and work that ends takes it first.

    Parameters
    ----------
    longest_s : float
        Longest time that such work may take, s.
    release : callable
        Takes the drive to zero.
    report : callable
        Called in the second thread with the time that it has taken, s, once a second.
    """

    def __init__(
        self, longest_s: float, release: Callable[[], None], report: Callable[[float], None]
    ) -> None:
        self._longest_s = longest_s
        self._release = release
        self._report = report
        self._lock = threading.Lock()
        self._since_s = math.inf
        self._set_s = -math.inf
        self._has_released = False
        self._is_ending = False
        self._thread = threading.Thread(target=self._watch, daemon=True, name="deadman")

    def __enter__(self) -> Deadman:  # noqa: PYI034 - Self needs Python 3.11
        self._timer = KernelTimer()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_ending = True
        self._timer.set(0.0)
        self._thread.join(_END_S)
        if not self._thread.is_alive():
            self._timer.close()

    def begin(self) -> None:
        """Take note that work outside the rig begins."""
        now_s = self._since_s = time.monotonic()
        # Set at each begin it would cost more than most of the work.
        if now_s - self._set_s > _SLACK_S:
            self._set_s = now_s
            self._timer.set(_SLACK_S + self._longest_s)

    def end(self) -> bool:
        """Take note that it has ended; return whether it took too long."""
        with self._lock:
            passed_s = time.monotonic() - self._since_s
            self._since_s = math.inf
        return passed_s > self._longest_s

    def has_released(self) -> bool:
        """Return whether the drive was taken to zero here since the last call."""
        released, self._has_released = self._has_released, False
        return released

    def _watch(self) -> None:
        reported_s = -math.inf
        while True:
            self._timer.wait()
            if self._is_ending:
                return
            with self._lock:
                now_s = time.monotonic()
                passed_s = now_s - self._since_s
                if passed_s > self._longest_s and not self._has_released:
                    self._has_released = True
                    self._release()
                if passed_s > 0.0:
                    self._timer.set(_POLL_S)
            if passed_s > _REPORT_S and now_s - reported_s > _REPORT_S:
                reported_s = now_s
                self._report(passed_s)

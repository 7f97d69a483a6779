"""Timer of the Linux kernel (timerfd), for a thread that must not disturb another one in Python.

A thread that polls takes the interpreter's lock at each turn, and a loop that is at work then has
to give it up and wait for it: at 2 kHz a poll of every 10 ms makes one sample in twenty late.
"""

from __future__ import annotations

import ctypes
import os

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
    """Timer that goes off once, on the monotonic clock.

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

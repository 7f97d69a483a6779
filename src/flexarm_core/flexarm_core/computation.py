"""Computing process and who asks it: requests, stages and results, a line of JSON each."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Protocol

from flexarm_core.errors import FlexarmError, one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    Compute = Callable[[Mapping[str, Any], "Report"], Mapping[str, Any]]

_LARGEST_ANSWER = 16_000_000
_INTERRUPTS = 4
_AGAIN_S = 0.2
_IDLE_S = 600.0
"""An idle process keeps its memory so long."""
_CANCELLED = {"error": "cancelled"}


class CancelledError(FlexarmError):
    """The computation was cancelled before it was done."""


class Report(Protocol):
    """Callback for the stage, the part that is done, and what is found already."""

    def __call__(
        self, stage: str, fraction: float | None, found: Mapping[str, Any] | None = None, /
    ) -> None:
        """Tell who waits."""


def serve(compute: Compute) -> None:
    """Compute what is asked for on the input, until it ends or is silent for long.

    An interrupt ends a computation, and what is half written is removed. One that comes too late
    does nothing.
    """
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while select.select([sys.stdin], [], [], _IDLE_S)[0] and (line := sys.stdin.readline()):
        _say(_answer(compute, line))


def _answer(compute: Compute, line: str) -> Mapping[str, Any]:
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        return {"result": compute(json.loads(line), _report)}
    except (FlexarmError, OSError, ValueError) as error:
        return {"error": one_line(error)}
    except KeyboardInterrupt:
        return _CANCELLED
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _report(stage: str, fraction: float | None, found: Mapping[str, Any] | None = None, /) -> None:
    _say({"stage": stage, "fraction": fraction, "found": found})


def _say(message: Mapping[str, Any]) -> None:
    # An interrupt shall not leave half a line.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    # What numpy has and JSON does not can be a list.
    sys.stdout.write(json.dumps(message, default=lambda value: value.tolist()) + "\n")
    sys.stdout.flush()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


class Computation:
    """Process that computes one request at a time.

    It reads a request as one line of JSON, and writes a line for each stage and one with the result
    or with the error; an interrupt makes it give up what it computes. It starts with the first
    request or before, and goes on waiting for the next one; it ends by itself when none comes for
    long.

    Parameters
    ----------
    module : str
        Module that serves it; see `serve`.
    """

    def __init__(self, module: str) -> None:
        self._module = module
        self._process: subprocess.Popen[bytes] | None = None
        self._is_cancelled = False
        self._ended = threading.Event()
        self._ended.set()

    def start(self) -> subprocess.Popen[bytes]:
        """Start the process, unless it runs: the first request then does not wait for it."""
        if self._process is None or self._process.poll() is not None:
            self._process = subprocess.Popen(  # noqa: S603 - our own module
                [sys.executable, "-m", self._module],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                # It finds the packages where this process found them.
                env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
                # Ctrl-C is for who asks, who cancels.
                start_new_session=True,
            )
        return self._process

    def begin(self, request: Mapping[str, Any]) -> None:
        """Hand over a request; `cancel` has an effect from now on."""
        self._is_cancelled = False
        self._ended = threading.Event()
        stdin = self.start().stdin
        assert stdin is not None  # noqa: S101 - piped
        with suppress(BrokenPipeError):
            stdin.write(json.dumps(request).encode() + b"\n")
            stdin.flush()

    def answer(self, report: Report) -> Mapping[str, Any]:
        """Return the result of what has begun; the thread that waits here calls `report`.

        Raises
        ------
        CancelledError
            After `cancel`, which leaves the process, or another one, ready for the next request.
        FlexarmError
            With the line of the process.
        """
        try:
            said = self._last_line(report)
        finally:
            self._ended.set()
        if said == _CANCELLED or (said is None and self._is_cancelled):
            raise CancelledError("cancelled")
        if said is None:
            raise FlexarmError("the computation has ended without a result: see the node's log")
        if "error" in said:
            raise FlexarmError(said["error"])
        result: dict[str, Any] = said["result"]
        return result

    def cancel(self) -> None:
        """Interrupt what has begun. Any thread may call, and oftener than once.

        A process that is in a compiled function for long, where it hears no interrupt, is killed.
        """
        if not (self._is_cancelled or self._ended.is_set()):
            self._is_cancelled = True
            threading.Thread(target=self._interrupt, args=(self._ended,), daemon=True).start()

    def close(self) -> None:
        """End the process, after what it computes is cancelled."""
        self.cancel()
        self._ended.wait(_INTERRUPTS * _AGAIN_S)
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def _interrupt(self, ended: threading.Event) -> None:
        process = self._process
        for number in (*[signal.SIGINT] * _INTERRUPTS, signal.SIGKILL):
            if process is None or ended.is_set():
                return
            # An interrupt that comes while an object is finalised is lost.
            process.send_signal(number)
            ended.wait(_AGAIN_S)

    def _last_line(self, report: Report) -> Mapping[str, Any] | None:
        """Return the last line that answers a request; None when the process ends without it."""
        process = self._process
        assert process is not None  # noqa: S101 - begun
        assert process.stdout is not None  # noqa: S101 - piped
        while line := process.stdout.readline(_LARGEST_ANSWER):
            said: dict[str, Any] = json.loads(line)
            if "stage" not in said:
                return said
            report(said["stage"], said["fraction"], said["found"])
        process.wait()
        return None

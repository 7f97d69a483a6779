"""Computing process and who asks it: requests, stages and results, a line of JSON each."""

from __future__ import annotations

import asyncio
import json
import os
import select
import signal
import subprocess
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Protocol

from flexarm_core.errors import FlexarmError, one_line
from flexarm_live.serving.encoding import as_json

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    Compute = Callable[[Mapping[str, Any], "Report"], Mapping[str, Any]]

_LARGEST_ANSWER = 16_000_000
_INTERRUPTS = 4
_AGAIN_S = 0.2
_IDLE_S = 600.0
"""An idle process keeps its memory so long."""


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


def _answer(compute: Compute, line: str) -> dict[str, Any]:
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        return {"result": compute(json.loads(line), _report)}
    except (FlexarmError, OSError, ValueError) as error:
        return {"error": one_line(error)}
    except KeyboardInterrupt:
        return {"error": "cancelled"}
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _report(stage: str, fraction: float | None, found: Mapping[str, Any] | None = None, /) -> None:
    _say({"stage": stage, "fraction": fraction, "found": found})


def _say(message: Mapping[str, Any]) -> None:
    # An interrupt shall not leave half a line.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    sys.stdout.write(as_json(message) + "\n")
    sys.stdout.flush()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


class Computation:
    """Process that computes one request at a time.

    It reads a request as one line of JSON, and writes a line for each stage and one with the result
    or with the error; an interrupt makes it give up what it computes. It starts with the first
    request, and goes on waiting for the next one; it ends by itself when none comes for long.

    Parameters
    ----------
    module : str
        Module that serves it; see `serve`.
    """

    def __init__(self, module: str) -> None:
        self._module = module
        self._process: subprocess.Popen[bytes] | None = None

    async def run(self, request: Mapping[str, Any], report: Report) -> Mapping[str, Any]:
        """Compute; what is cancelled meanwhile leaves the process ready for the next request.

        Raises
        ------
        FlexarmError
            With the line of the process.
        """
        process = self._process
        if process is None or process.poll() is not None:
            process = self._process = self._started()
        answer = asyncio.create_task(_last_answer(process, request, report))
        try:
            said = await asyncio.shield(answer)
        except asyncio.CancelledError:
            for _ in range(_INTERRUPTS):
                # One that comes while an object is finalised is lost.
                process.send_signal(signal.SIGINT)
                if (await asyncio.wait({answer}, timeout=_AGAIN_S))[0]:
                    break
            if not answer.done() or answer.cancelled() or answer.exception():
                answer.cancel()
                # It is in a compiled function, where it would hear no other signal.
                process.kill()
                self._process = None
            raise
        if "error" in said:
            raise FlexarmError(said["error"])
        result: dict[str, Any] = said["result"]
        return result

    def _started(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-m", self._module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            # It finds the packages where this process found them.
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        )


async def _last_answer(
    process: subprocess.Popen[bytes], request: Mapping[str, Any], report: Report
) -> Mapping[str, Any]:
    """Return the last line that answers a request."""
    assert process.stdin is not None  # noqa: S101 - piped
    assert process.stdout is not None  # noqa: S101 - piped
    with suppress(BrokenPipeError):
        process.stdin.write(json.dumps(request).encode() + b"\n")
        process.stdin.flush()
    while line := await asyncio.to_thread(process.stdout.readline, _LARGEST_ANSWER):
        said: dict[str, Any] = json.loads(line)
        if "stage" not in said:
            return said
        report(said["stage"], said["fraction"], said["found"])
    await asyncio.to_thread(process.wait)
    raise FlexarmError("the computation has ended without a result: see the log of node live")

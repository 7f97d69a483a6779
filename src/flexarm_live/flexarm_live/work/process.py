"""Frame of a computing process: requests in, stages and results out, a line of JSON each."""

from __future__ import annotations

import json
import select
import signal
import sys
from typing import TYPE_CHECKING, Any, Protocol

from flexarm_core.errors import FlexarmError, one_line
from flexarm_live.serving.encoding import as_json

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    Compute = Callable[[Mapping[str, Any], "Report"], Mapping[str, Any]]

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

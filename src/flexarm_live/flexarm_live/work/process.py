"""Frame of a computing process: a request in, stages and a result out, all as JSON."""

from __future__ import annotations

import json
import signal
import sys
from typing import TYPE_CHECKING, Any

from flexarm_core.errors import FlexarmError, one_line
from flexarm_live.serving.encoding import as_json

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flexarm_core.arrays import Progress

    Compute = Callable[[Mapping[str, Any], Progress], Mapping[str, Any]]


def serve(compute: Compute) -> None:
    """Read a request from the input, compute, and write stages and result to the output."""
    # An exception, so that what is half written is removed.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    request = json.load(sys.stdin)
    try:
        result = compute(request, lambda stage, done: _say({"stage": stage, "fraction": done}))
    except (FlexarmError, OSError, ValueError) as error:
        _say({"error": one_line(error)})
    else:
        _say({"result": result})


def _say(message: Mapping[str, Any]) -> None:
    sys.stdout.write(as_json(message) + "\n")
    sys.stdout.flush()

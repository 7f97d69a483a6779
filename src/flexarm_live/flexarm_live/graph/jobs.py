"""Long work: told from its begin to its end, one of a kind at a time, and cancelled."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from itertools import count
from typing import TYPE_CHECKING, Any

from flexarm_core.errors import FlexarmError, one_line

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping

    Tell = Callable[[Mapping[str, Any]], None]
    Report = Callable[[str, float | None], None]
    Work = Callable[[Report], Awaitable[Mapping[str, Any]]]

LARGEST_RESULT = 16_000_000


class Jobs:
    """Jobs of a laboratory.

    Parameters
    ----------
    tell : callable
        Gets each message to the pages.
    """

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._numbers = count(1)
        self._at_work: dict[int, tuple[str, asyncio.Task[None]]] = {}

    @property
    def at_work(self) -> list[int]:
        """Numbers of the jobs that have not ended."""
        return list(self._at_work)

    def start(self, kind: str, work: Work) -> int:
        """Start work and return its number; a `FlexarmError` while one of its kind is at work."""
        for number, (other, _) in self._at_work.items():
            if other == kind:
                raise FlexarmError(f"job {number}, {kind}, is at work: cancel it or wait")
        number = next(self._numbers)
        task = asyncio.create_task(self._run(number, kind, work))
        self._at_work[number] = (kind, task)
        task.add_done_callback(lambda _: self._at_work.pop(number, None))
        return number

    def cancel(self, number: int) -> str:
        """Cancel a job and return its kind; a `FlexarmError` when there is none of the number."""
        if number not in self._at_work:
            raise FlexarmError(f"no job {number} is at work")
        kind, task = self._at_work[number]
        task.cancel()
        return kind

    async def _run(self, number: int, kind: str, work: Work) -> None:
        def say(stage: str, fraction: float | None, **more: Any) -> None:  # noqa: ANN401 - of JSON
            news: dict[str, Any] = {
                "fraction": fraction,
                "done": False,
                "ok": False,
                "message": "",
                "data": {},
            }
            self._tell({"type": "job", "job": kind, "id": number, "stage": stage, **news, **more})

        say("starting", 0.0)
        try:
            data = await work(say)
        except asyncio.CancelledError:
            say("cancelled", None, done=True, message="cancelled: nothing was written")
        except FlexarmError as error:
            say("failed", None, done=True, message=one_line(error))
        except Exception as error:
            say("failed", None, done=True, message=f"internal error: {one_line(error)}")
            raise
        else:
            say("done", 1.0, done=True, ok=True, data=data)


async def computed(module: str, request: Mapping[str, Any], report: Report) -> Mapping[str, Any]:
    """Compute in a process of its own, which a cancelled job ends.

    The process reads the request from its input and writes one line of JSON for each stage, and at
    last one with the result or with the error.

    Raises
    ------
    FlexarmError
        With the line of the process.
    """
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", module),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        limit=LARGEST_RESULT,
        # It finds the packages where this process found them.
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert process.stdin is not None  # noqa: S101 - piped above
    assert process.stdout is not None  # noqa: S101 - piped above
    try:
        process.stdin.write(json.dumps(request).encode())
        process.stdin.close()
        while line := await process.stdout.readline():
            said: dict[str, Any] = json.loads(line)
            if "error" in said:
                raise FlexarmError(said["error"])
            if "result" in said:
                result: dict[str, Any] = said["result"]
                return result
            report(said["stage"], said["fraction"])
        raise FlexarmError("the computation has ended without a result: see the log of node live")
    finally:
        if process.returncode is None:
            process.terminate()
        await process.wait()

"""Long work: told from its begin to its end, one of a kind at a time, and cancelled."""

from __future__ import annotations

import asyncio
from itertools import count
from typing import TYPE_CHECKING, Any

from flexarm_core.errors import FlexarmError, one_line

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping

    from flexarm_live.work.process import Report

    Tell = Callable[[Mapping[str, Any]], None]
    Work = Callable[[Report], Awaitable[Mapping[str, Any]]]


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
        self._cancelled: set[int] = set()

    @property
    def at_work(self) -> list[int]:
        """Numbers of the jobs that have not ended."""
        return list(self._at_work)

    def require_none(self, kind: str) -> None:
        """Raise a `FlexarmError` while a job of a kind is at work."""
        number = self._number_of(kind)
        if number is not None:
            raise FlexarmError(f"job {number}, {kind}, is at work: cancel it or wait")

    def has(self, kind: str) -> bool:
        """Return whether a job of a kind is at work."""
        return self._number_of(kind) is not None

    def start(self, kind: str, work: Work, *, left: str = "nothing was written") -> int:
        """Start work and return its number; a `FlexarmError` while one of its kind is at work.

        What is `left` of it is told when it is cancelled.
        """
        self.require_none(kind)
        number = next(self._numbers)
        task = asyncio.create_task(self._run(number, kind, work, left))
        self._at_work[number] = (kind, task)
        task.add_done_callback(lambda _: self._forget(number))
        return number

    def cancel(self, number: int) -> str:
        """Cancel a job and return its kind; a `FlexarmError` when there is none of the number.

        A second time changes nothing: it would break off what the job does to end well.
        """
        if number not in self._at_work:
            raise FlexarmError(f"no job {number} is at work")
        kind, task = self._at_work[number]
        if number not in self._cancelled:
            self._cancelled.add(number)
            task.cancel()
        return kind

    def _number_of(self, kind: str) -> int | None:
        """Return the number of the job of a kind that is at work; None without one."""
        return next((number for number, (own, _) in self._at_work.items() if own == kind), None)

    def _forget(self, number: int) -> None:
        del self._at_work[number]
        self._cancelled.discard(number)

    async def _run(self, number: int, kind: str, work: Work, left: str) -> None:
        def say(stage: str, fraction: float | None, **more: Any) -> None:  # noqa: ANN401 - of JSON
            news: dict[str, Any] = {
                "fraction": fraction,
                "done": False,
                "ok": False,
                "message": "",
                "data": {},
            }
            self._tell({"type": "job", "job": kind, "id": number, "stage": stage, **news, **more})

        def report(
            stage: str, fraction: float | None, found: Mapping[str, Any] | None = None, /
        ) -> None:
            say(stage, fraction, data=found or {})

        say("starting", 0.0)
        try:
            data = await work(report)
        except asyncio.CancelledError:
            say("cancelled", None, done=True, message=f"cancelled: {left}")
        except FlexarmError as error:
            say("failed", None, done=True, message=one_line(error))
        except Exception as error:
            say("failed", None, done=True, message=f"internal error: {one_line(error)}")
            raise
        else:
            say("done", 1.0, done=True, ok=True, data=data)

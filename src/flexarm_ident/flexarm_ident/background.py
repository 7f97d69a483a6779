"""Background work in a thread of its own, with progress and cancellation."""

from __future__ import annotations

import threading
from queue import SimpleQueue
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flexarm_core.arrays import Progress

Result = TypeVar("Result")


class Cancelled(Exception):  # noqa: N818 - no error: somebody asked for it
    """The work was cancelled before it was done."""


class Background(Generic[Result]):
    """Runs `work` in a thread, from now on.

    Parameters
    ----------
    work : callable
        Called with a progress callback, which raises `Cancelled` when the work is to stop.
    cancelled : callable
        Called in the thread, at every progress; True stops the work.
    notify : callable
        Called from the thread when there is progress, and when the work has ended.
    """

    def __init__(
        self,
        work: Callable[[Progress], Result],
        *,
        cancelled: Callable[[], bool],
        notify: Callable[[], None],
    ) -> None:
        self._work = work
        self._cancelled = cancelled
        self._notify = notify
        self._progress: SimpleQueue[tuple[str, float]] = SimpleQueue()
        self._ended = threading.Event()
        self._result: Result
        self._error: BaseException | None = None
        # A stage may take long: it must not keep a process that was told to stop.
        self._thread = threading.Thread(target=self._run, daemon=True, name="background")
        self._thread.start()

    @property
    def ended(self) -> bool:
        """True when there is a result or an error, and no further progress."""
        return self._ended.is_set()

    def progress(self) -> Iterator[tuple[str, float]]:
        """Yield the stages and fractions reported since the last call, oldest first."""
        while not self._progress.empty():
            yield self._progress.get()

    def result(self) -> Result:
        """Return what the work returned, or raise what it raised; only after the end."""
        if self._error is not None:
            raise self._error
        return self._result

    def join(self, timeout_s: float) -> None:
        """Wait for the end, at most `timeout_s`."""
        self._thread.join(timeout_s)

    def _run(self) -> None:
        try:
            self._result = self._work(self._report)
        except BaseException as error:  # noqa: BLE001 - handed to the thread that asks
            self._error = error
        self._ended.set()
        self._notify()

    def _report(self, stage: str, fraction: float) -> None:
        if self._cancelled():
            raise Cancelled(f"cancelled before {stage}")
        self._progress.put((stage, fraction))
        self._notify()

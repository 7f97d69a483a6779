"""Background work in a thread of its own, with progress and cancellation."""

from __future__ import annotations

import ctypes
import threading
import time
from queue import SimpleQueue
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flexarm_core.arrays import Progress

Result = TypeVar("Result")
_SMALLEST_PART = 0.01


class Cancelled(BaseException):
    """The work was cancelled before it was done; work that tries on after errors lets it pass."""


class Background(Generic[Result]):
    """Runs `work` in a thread, from now on.

    Parameters
    ----------
    work : callable
        Called with a progress callback. `Cancelled` is raised wherever it is when it is to stop; a
        compiled function ends first.
    notify : callable
        Called from a thread when there is progress, when the work has ended, and when it goes on
        although it was cancelled.
    patience_s : float
        Time after which cancelled work is given up, s.
    """

    def __init__(
        self, work: Callable[[Progress], Result], *, notify: Callable[[], None], patience_s: float
    ) -> None:
        self._work = work
        self._notify = notify
        self._patience_s = patience_s
        self._cancelled = threading.Event()
        self._given_up_s = 0.0
        self._stage = "its beginning"
        self._left: set[str] = set()
        self._fraction = 0.0
        self._reported: tuple[str, float] = ("", 0.0)
        self._ending = threading.Lock()
        self._is_over = False
        self._progress: SimpleQueue[tuple[str, float]] = SimpleQueue()
        self._ended = threading.Event()
        self._result: Result
        self._error: BaseException | None = None
        # A stage may take long: it must not keep a process that was told to stop.
        self._thread = threading.Thread(target=self._run, daemon=True, name="background")
        self._thread.start()

    @property
    def ended(self) -> bool:
        """True when there is a result or an error, or cancelled work is given up."""
        return self._ended.is_set() or self._is_given_up()

    @property
    def stage(self) -> str:
        """Stage that the work reported last."""
        return self._stage

    def progress(self) -> Iterator[tuple[str, float]]:
        """Yield the news since the last call, oldest first: a stage that is new, or more done.

        Nothing goes back: a fraction never falls, and a stage that was left is not named again.
        """
        while not self._progress.empty():
            yield self._progress.get()

    def result(self) -> Result:
        """Return what the work returned, or raise what it raised; only after the end.

        Raises
        ------
        Cancelled
            When the work was given up too. It ends when its compiled function does.
        """
        if not self._ended.is_set():
            raise Cancelled(f"cancelled in {self._stage}, which does not stop and is left behind")
        if self._error is not None:
            raise self._error
        return self._result

    def cancel(self) -> None:
        """Stop the work where it is, or give it up."""
        if self._cancelled.is_set():
            return
        self._given_up_s = time.monotonic() + self._patience_s
        self._cancelled.set()
        with self._ending:
            if not self._is_over and self._thread.ident is not None:
                thread = ctypes.c_ulong(self._thread.ident)
                ctypes.pythonapi.PyThreadState_SetAsyncExc(thread, ctypes.py_object(Cancelled))
        waking = threading.Timer(self._patience_s, self._notify)
        waking.daemon = True
        waking.start()

    def join(self, timeout_s: float) -> None:
        """Wait for the end, at most `timeout_s`."""
        self._thread.join(timeout_s)

    def _is_given_up(self) -> bool:
        return self._cancelled.is_set() and time.monotonic() >= self._given_up_s

    def _run(self) -> None:
        try:
            try:
                self._result = self._work(self._report)
            finally:
                with self._ending:
                    self._is_over = True
        except Cancelled:
            if not hasattr(self, "_result"):
                self._error = Cancelled(f"cancelled in {self._stage}")
        except BaseException as error:  # noqa: BLE001 - handed to the thread that asks
            self._error = error
        self._ended.set()
        self._notify()

    def _report(self, stage: str, fraction: float) -> None:
        if self._cancelled.is_set():
            raise Cancelled
        if stage != self._stage and stage not in self._left:
            self._left.add(self._stage)
            self._stage = stage
        self._fraction = max(self._fraction, fraction)
        reported_stage, reported = self._reported
        if self._stage == reported_stage and self._fraction < min(reported + _SMALLEST_PART, 1.0):
            return
        if (self._stage, self._fraction) == self._reported:
            return
        self._reported = self._stage, self._fraction
        self._progress.put(self._reported)
        self._notify()

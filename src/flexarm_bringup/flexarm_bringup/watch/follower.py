"""Follower of a running arm: its state and samples, asked for in a thread, and its set-point."""

from __future__ import annotations

import math
import threading
import time
from typing import TYPE_CHECKING, Any

from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.graph.socket_client import NoAnswerError, socket_client, through
from flexarm_bringup.watch.screen import History, Units
from flexarm_core.errors import FlexarmError, one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import TracebackType

    from flexarm_bringup.graph.socket_client import SocketClient

_ASK_S = 0.1
_RETRY_S = 1.0
_RELEASE_S = 60.0
# The server's word on the set-point is older than the user's while one is on its way.
_OWN_WORD_S = 0.8


class Follower:
    """Follower of one arm, as long as its context.

    What takes long, or never comes back, waits in threads that do not outlive the process: the keys
    are heard all the while.

    Parameters
    ----------
    namespace : str
        Namespace of the arm.

    Attributes
    ----------
    state : mapping
        Newest state.
    history : History
        Samples.
    units : Units
        Units of the channels.
    note : str
        What the last command has led to.
    """

    def __init__(self, namespace: str) -> None:
        self.state: Mapping[str, Any] = {}
        self.history = History()
        self.note = ""
        self._namespace = namespace
        self._taken = 0
        self._moved_v, self._moved_s = 0.0, -math.inf
        self._news = threading.Event()
        self._ending = threading.Event()

    def __enter__(self) -> Follower:  # noqa: PYI034 - Self needs Python 3.11
        """Ask for what does not change, and follow.

        Raises
        ------
        LaunchError
            When no `up` of the arm runs.
        """
        try:
            with socket_client(self._namespace) as arm:
                hello = arm.ask("hello").data
                self._ask(arm)
        except NoAnswerError as error:
            raise LaunchError(
                f"{one_line(error)}: start it with ./flexarm up, without --no-page (one that has "
                "lost its page is ended by Ctrl-C first), or name its --namespace or ROS_DOMAIN_ID"
            ) from error
        self.units = Units(hello)
        _start(self._follow)
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc_value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._ending.set()

    def stop(self) -> None:
        """Hold the drive at zero, at once; over the graph when `up` does not answer."""
        self.note = "STOP ..."
        self._command(lambda: through(self._namespace, lambda arm: arm.stop()))

    def release(self) -> None:
        """Begin a new run after a stop."""
        self.note = "releasing ..."

        def released() -> str:
            with socket_client(self._namespace) as arm:
                return arm.ask("release", _RELEASE_S).message

        self._command(released)

    def move_by(self, degrees: float) -> None:
        """Move the first set-point, degrees; of one that is not an angle as many per cent of it."""
        is_ours = time.monotonic() - self._moved_s < _OWN_WORD_S
        in_force = next(iter(self.state.get("references", ())), None)
        here_v = self._moved_v if is_ours else in_force or 0.0
        for first in self.units.set_points[:1]:
            low, high = _ends(first)
            percent = (high - low) / 100.0 if math.isfinite(high - low) else 1.0
            name = first["name"]
            degree = 1.0 / self.units.per_v(name) if self.units.is_angle(name) else percent
            self.move_to(here_v + degrees * degree)

    def move_to(self, wanted_v: float) -> None:
        """Move the first set-point, in its own unit, within the travel."""
        for first in self.units.set_points[:1]:
            low, high = _ends(first)
            self._moved_v = min(high, max(low, wanted_v))
            self._moved_s = time.monotonic()
            self._news.set()

    def _command(self, command: Callable[[], str]) -> None:
        def carry_out() -> None:
            try:
                self.note = command()
            # Libraries raise errors of their own.
            except (FlexarmError, OSError, RuntimeError, ValueError) as error:
                self.note = f"refused: {one_line(error)}"

        _start(carry_out)

    def _follow(self) -> None:
        while not self._ending.is_set():
            self._attend()
            self._ending.wait(_RETRY_S)

    def _attend(self) -> None:
        """Follow as long as `up` answers."""
        try:
            with socket_client(self._namespace) as arm:
                # What was wanted while nobody answered is not news any more.
                self._news.clear()
                while not self._ending.is_set():
                    self._ask(arm)
                    if self._news.wait(_ASK_S):
                        self._news.clear()
                        self._send(arm, self._moved_v)
        except LaunchError as error:
            self.state = {"badge": "UNKNOWN", "reason": one_line(error), "tone": "failure"}

    def _send(self, arm: SocketClient, wanted_v: float) -> None:
        try:
            first, *others = self.units.set_points
            in_force = arm.reference(wanted_v, first["joint"] if others else "")
            shown = self.units.shown(first["name"], in_force.value)
            words = [f"set-point {shown}", in_force.note]
            self.note = ": ".join(filter(None, words))
        except NoAnswerError:
            raise
        except LaunchError as error:
            self.note = f"refused: {one_line(error)}"

    def _ask(self, arm: SocketClient) -> None:
        self.state = arm.ask("status").data
        found = arm.ask("samples", after=self._taken).data
        self._taken = found["taken"]
        self.history.add(found["t_s"], found["values"])


def _ends(set_point: Mapping[str, Any]) -> tuple[float, float]:
    """Return the travel of a set-point; an end that is not known is none."""
    low, high = set_point["low"], set_point["high"]
    return (-math.inf if low is None else low), (math.inf if high is None else high)


def _start(work: Callable[[], None]) -> None:
    threading.Thread(target=work, daemon=True).start()

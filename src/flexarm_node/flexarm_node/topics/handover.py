"""Hand-over of samples and commands between two nodes of one process.

A sample goes from thread to thread without the middleware. Its message is published beside it, for
everybody else. The sampling thread never waits for the law: when that hangs or fails, the sampling
goes on and the drive goes to zero, as with two processes.

In virtual time that goes as fast as it can, every sample waits for the law anyway. The sampling
thread then runs the law itself: two changes of thread a sample would take longer than its work.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from contextlib import contextmanager
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flexarm_node.topics.layout import Numbers
    from flexarm_node.topics.waiting import TopicWaiter

Item = TypeVar("Item")

# More than are ever on their way from the node to its own process.
_REMEMBERED = 100


class Mailbox(Generic[Item]):
    """Newest item from one thread to one other."""

    def __init__(self) -> None:
        self._items: deque[Item] = deque(maxlen=1)
        self._filled = threading.Lock()
        self._filled.acquire()

    def put(self, item: Item) -> None:
        """Leave an item in the place of an older one."""
        self._items.append(item)
        if self._filled.locked():
            self._filled.release()

    def wait_newest(self, timeout_s: float) -> Item | None:
        """Return the item that waits, or one that comes within the time."""
        until_s = time.monotonic() + timeout_s
        # The lock may be open for an item that was taken before.
        while not self._items:
            if not self._filled.acquire(timeout=max(0.0, until_s - time.monotonic())):
                break
        return self._items.popleft() if self._items else None

    def close(self) -> None:
        """Drop what waits."""
        self._items.clear()


class DirectHandover:
    """Way of the samples and the commands between the loops of two nodes.

    Attributes
    ----------
    states : Mailbox of Numbers
        Samples, ArmState.
    commands : Mailbox of Numbers
        Commands, MotorCommand.
    answers : bool
        True while the loop of the node that commands runs.
    waits : bool
        True where every sample waits for its answer, in virtual time.
    turn : Lock
        Held by the thread that does the work of the node that commands.
    """

    def __init__(self) -> None:
        self.states: Mailbox[Numbers] = Mailbox()
        self.commands: Mailbox[Numbers] = Mailbox()
        self.answers = False
        self.waits = False
        self.turn = threading.Lock()
        self._answer: Callable[[Numbers], None] | None = None
        self._is_asked = False
        self._failure: Exception | None = None
        self._given: deque[Numbers] = deque(maxlen=_REMEMBERED)

    def ask(self, state: Numbers) -> None:
        """Have a sample answered in the calling thread, where the node that commands is active.

        An error of the answer belongs to that node: its own loop raises it, see `check`.
        """
        with self.turn:
            if self._answer is None:
                return
            self._is_asked = True
            try:
                self._answer(state)
            except Exception as error:  # noqa: BLE001 - the sampling goes on
                self._answer, self._failure = None, error
            finally:
                self._is_asked = False

    def check(self) -> None:
        """Raise the error of an answer that `ask` was told."""
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure

    def give(self, command: Numbers) -> None:
        """Hand a command over, before it is published, and let the other thread act on it."""
        self._given.append(command)
        self.commands.put(command)
        if not self._is_asked:
            # It needs the interpreter, which this thread would keep for the message.
            time.sleep(0.0)

    @contextmanager
    def answering(self, answer: Callable[[Numbers], None]) -> Iterator[None]:
        """Tell the other end that commands are to be expected from this one.

        Parameters
        ----------
        answer : callable
            Gives the command that answers a sample.
        """
        self._answer, self._failure = answer, None
        self.answers = True
        try:
            yield
        finally:
            self.answers = False
            with self.turn:
                self._answer = None

    def was_given(self, command: Numbers) -> bool:
        """Return whether a command from the topic is one that was handed over."""
        # A copy: another thread may be adding to it.
        return any(command == own for own in reversed(tuple(self._given)))


class CommandWaiter:
    """Commands that are handed over, and those of others from the topic.

    Another commander is heard beside the one of this process, at least once a sample: it may take
    its place, and two at once are a fault.

    Parameters
    ----------
    handover : DirectHandover
        Way from the commander of this process.
    others : TopicWaiter
        Subscription of the topic, on which its commands come too.
    """

    def __init__(self, handover: DirectHandover, others: TopicWaiter) -> None:
        self._handover = handover
        self._others = others
        self._others_are_next = False

    @property
    def topic(self) -> str:
        """Full name of the topic, after remapping."""
        return self._others.topic

    def publishers(self) -> int:
        """Return how many publishers of the topic the graph knows."""
        return self._others.publishers()

    def wait_newest(self, timeout_s: float) -> Numbers | None:
        """Return a command, or None when none came in time."""
        if not self._handover.answers:
            command = self._of_others(timeout_s)
            return self._handover.commands.wait_newest(0.0) if command is None else command
        if self._others_are_next:
            self._others_are_next = False
            if (command := self._of_others(0.0)) is not None:
                return command
        command = self._handover.commands.wait_newest(timeout_s)
        self._others_are_next = command is not None
        return self._of_others(0.0) if command is None else command

    def close(self) -> None:
        """Remove the subscription. No thread may be waiting any more."""
        self._others.close()
        self._handover.commands.close()

    def _of_others(self, timeout_s: float) -> Numbers | None:
        heard = self._others.wait_all(timeout_s)
        return next((each for each in reversed(heard) if not self._handover.was_given(each)), None)

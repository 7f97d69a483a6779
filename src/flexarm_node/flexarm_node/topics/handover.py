"""Hand-over of samples and commands between two nodes of one process.

The sampling thread runs the law itself: two changes of thread a sample take longer than most laws.
What the answer does not need, messages for everybody else among it, waits until the command has
acted.

A law that hangs holds up the sampling. The DAQ node has a second thread that takes the drive to
zero then.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flexarm_core.signals import Command, Sample
    from flexarm_node.topics.waiting import TopicWaiter

    Work = Callable[[], None]

# More than are ever on their way from the node to its own process.
_REMEMBERED = 100


def _nothing() -> None:
    pass


class DirectHandover:
    """Way of the samples and the commands between the loops of two nodes.

    Everything is done in the thread that samples, but for the begin and the end of `answering`. An
    error of the node that commands belongs to that node: its own loop raises it, see `check`.

    Attributes
    ----------
    answers : bool
        True while the loop of the node that commands runs.
    waits : bool
        True where every sample waits for its answer, in virtual time.
    turn : Lock
        Held by the thread that does the work of the node that commands.
    """

    def __init__(self) -> None:
        self.answers = False
        self.waits = False
        self.turn = threading.Lock()
        self._answer: Callable[[Sample], None] | None = None
        self._spare_time: Work = _nothing
        self._was_asked = False
        self._command: Command | None = None
        self._rest: Work = _nothing
        self._failure: Exception | None = None
        self._given: deque[Command] = deque(maxlen=_REMEMBERED)

    def ask(self, sample: Sample) -> None:
        """Have a sample answered, where the node that commands is active."""
        with self.turn:
            if self._answer is not None:
                self._was_asked = True
                answer = self._answer
                self._do(lambda: answer(sample))

    def give(self, command: Command, rest: Work = _nothing) -> None:
        """Hand a command over; called by the answer, which leaves the rest of its work."""
        self._given.append(command)
        self._command, self._rest = command, rest

    def take(self) -> Command | None:
        """Return the command that was given; None when there is none, or it was taken."""
        command, self._command = self._command, None
        return command

    def acted(self) -> None:
        """Do the rest of the work for a command that has acted."""
        with self.turn:
            self._do_rest()

    def spare_time(self) -> None:
        """Do work of the node that commands that can wait."""
        with self.turn:
            self._do(self._spare_time)

    def check(self) -> None:
        """Raise the error of the node that commands, if there was one; called in its own loop.

        Where nobody has asked since the last call, this one does the work that can wait.
        """
        with self.turn:
            if not self._was_asked:
                self._do(self._spare_time)
            self._was_asked = False
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure

    @contextmanager
    def answering(self, answer: Callable[[Sample], None], spare_time: Work) -> Iterator[None]:
        """Tell the other end that commands are to be expected from this one.

        Parameters
        ----------
        answer : callable
            Gives the command that answers a sample.
        spare_time : callable
            Does short work that can wait.
        """
        self._failure = None
        self._answer, self._spare_time = answer, spare_time
        self.answers = True
        try:
            yield
        finally:
            self.answers = False
            with self.turn:
                self._answer, self._spare_time = None, _nothing
                self._do_rest()

    def was_given(self, command: Command) -> bool:
        """Return whether a command from the topic is one that was handed over."""
        return any(command == own for own in reversed(self._given))

    def _do_rest(self) -> None:
        rest, self._rest = self._rest, _nothing
        self._do(rest)

    def _do(self, work: Work) -> None:
        """Do work of the node that commands; after an error it is not asked again."""
        try:
            work()
        except Exception as error:  # noqa: BLE001 - the sampling goes on
            self._answer, self._spare_time, self._failure = None, _nothing, error


class CommandWaiter:
    """Commands that are handed over, and those of others from the topic.

    Another commander is heard beside the one of this process, at least once a sample: it may take
    its place, and two at once are a fault.

    Parameters
    ----------
    handover : DirectHandover
        Way from the commander of this process.
    others : TopicWaiter of Command
        Subscription of the topic, on which its commands come too.
    """

    def __init__(self, handover: DirectHandover, others: TopicWaiter[Command]) -> None:
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

    def wait_newest(self, timeout_s: float) -> Command | None:
        """Return a command, or None when none came in time."""
        # Its reader would be full one day, and no message on the topic acknowledged any more.
        if self._others_are_next and (other := self._of_others(0.0)) is not None:
            return other
        command = self._handover.take()
        self._others_are_next = command is not None
        if command is not None:
            return command
        if not self._handover.answers:
            return self._of_others(timeout_s)
        # The topic brings the answer of this process once more, which would end a wait there.
        time.sleep(timeout_s)
        return self._of_others(0.0)

    def close(self) -> None:
        """Remove the subscription. No thread may be waiting any more."""
        self._others.close()
        self._handover.take()

    def _of_others(self, timeout_s: float) -> Command | None:
        heard = self._others.wait_all(timeout_s)
        return next((each for each in reversed(heard) if not self._handover.was_given(each)), None)

"""Commander in force: one at a time, with its commands in order, each for a sample of its own.

The middleware does not name the sender of a message. A commander numbers its commands, however, and
sends one for each sample that it answers. Between two of its commands its own count therefore grows
by at least one and at most by the count of the samples. A command that does not fit is not obeyed.
When the commander in force continues beside it, there are two commanders. When it is silent,
another sender takes its place. One that does not count would drive with its first command after
each silence: a number that came first or last of a reign does not begin another one. Such a
command, and one of a sender whose commands were refused, has to be followed by one that counts on.
"""

from __future__ import annotations

from collections import Counter, deque
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flexarm_core.signals import Command


class Verdict(Enum):
    """Verdict on a command."""

    ACCEPTED = "accepted"
    DUPLICATE = "duplicate"
    """It repeats the last accepted command."""
    OLD = "old"
    """It answers a sample that has an answer already."""
    AHEAD = "ahead"
    """It answers a sample that was not taken yet."""
    LATE = "late"
    """It answers a sample that is too old to drive by, or a number that no sample has."""
    FOREIGN = "foreign"
    """It does not continue the count of the commander in force."""
    CONFLICT = "conflict"
    """It proves that there are two commanders."""


_REMEMBERED = 1000
"""Numbers that no reign begins with: more than a sender goes through that counts in a circle."""


class Commander:
    """Record of the commander in force.

    The first sender that answers a sample is in force until it is released for its silence. The
    next sender that answers may be another one.

    Attributes
    ----------
    verdicts : Counter of Verdict
        Number of times that each verdict was given.
    answered : int
        Newest sample that has an accepted answer.
    """

    def __init__(self) -> None:
        self.verdicts: Counter[Verdict] = Counter()
        self.answered = 0
        self._last: Command | None = None
        self._has_rival = False
        self._foreign: Command | None = None
        self._spent: deque[int] = deque(maxlen=_REMEMBERED)
        self._ended: Command | None = None

    def release(self) -> None:
        """Forget the commander, which is silent."""
        self._ended = self._last or self._ended
        self._last = None
        self._has_rival = False

    def judge(self, command: Command, newest: int, *, in_time: bool = True) -> Verdict:
        """Judge a command by the number of the newest sample; only an accepted one may act.

        Parameters
        ----------
        command : Command
            Command that has arrived.
        newest : int
            Number of the newest sample.
        in_time : bool
            False: the sample that the command answers is too old.

        Returns
        -------
        Verdict
            Verdict, also counted in `verdicts`.
        """
        verdict = self._verdict(command, newest)
        if verdict is Verdict.FOREIGN:
            self._has_rival = self._last is not None
            self._foreign = command
        if verdict is Verdict.ACCEPTED and not in_time:
            verdict = Verdict.LATE
        if verdict is Verdict.ACCEPTED:
            self._foreign = None
            # Where each command is stale with the next sample, a reign of one follows the other.
            if self._last is None and not self._goes_on(command):
                self._spent.extend(each.sequence for each in (self._ended, command) if each)
            if self._has_rival:
                verdict = Verdict.CONFLICT
            self._last = command
            self.answered = command.state_sequence
        self.verdicts[verdict] += 1
        return verdict

    def _verdict(self, command: Command, newest: int) -> Verdict:
        if command.state_sequence > newest:
            return Verdict.AHEAD
        last = self._last
        if last is None or command.state_sequence < 1:
            return self._first_verdict(command)
        if command == last:
            return Verdict.DUPLICATE
        if command.state_sequence == last.state_sequence:
            return Verdict.CONFLICT
        if not _counts_on(last, command):
            return Verdict.FOREIGN
        return Verdict.ACCEPTED if command.state_sequence > last.state_sequence else Verdict.OLD

    def _first_verdict(self, command: Command) -> Verdict:
        """Judge a command while there is no commander in force."""
        if command.state_sequence <= self.answered:
            return Verdict.OLD
        counts = self._foreign is None or _counts_on(self._foreign, command)
        has_ended = self._ended is not None and command.sequence == self._ended.sequence
        is_new = not has_ended and command.sequence not in self._spent
        return Verdict.ACCEPTED if counts and is_new else Verdict.FOREIGN

    def _goes_on(self, command: Command) -> bool:
        """Return whether the last commander has answered every sample since its last command."""
        if self._ended is None:
            return False
        samples = command.state_sequence - self._ended.state_sequence
        return command.sequence - self._ended.sequence == samples


def _counts_on(last: Command, command: Command) -> bool:
    """Return whether two commands, in any order, may be of one commander."""
    commands = command.sequence - last.sequence
    samples = command.state_sequence - last.state_sequence
    return 1 <= (commands if samples > 0 else -commands) <= abs(samples)

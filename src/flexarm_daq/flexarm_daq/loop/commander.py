"""Commander in force: one at a time, its commands in order, each for a sample of its own.

The middleware does not tell who sent a message. But a commander numbers its commands, and sends one
for each sample that it answers, so between two of them its own count grows by at least one and by
no more than the count of the samples. A command that does not fit is not obeyed; when the
commander in force goes on beside it, there are two of them.
"""

from __future__ import annotations

from collections import Counter
from enum import Enum
from typing import NamedTuple


class Command(NamedTuple):
    """Request of a controller in answer to one sample, V."""

    sequence: int
    state_sequence: int
    effort_v: float
    compensation_v: float
    stamp_ns: int = 0


class Verdict(Enum):
    """Verdict on a command."""

    ACCEPTED = "accepted"
    DUPLICATE = "duplicate"
    """The last accepted command once more."""
    OLD = "old"
    """It answers a sample that is answered already."""
    AHEAD = "ahead"
    """It answers a sample that was not taken yet."""
    FOREIGN = "foreign"
    """It does not continue the count of the commander in force."""
    CONFLICT = "conflict"
    """It proves that there are two commanders."""


class Commander:
    """Follows the commander in force.

    The first one that answers a sample is in force until it is released for its silence; then the
    next one that answers may be another.

    Attributes
    ----------
    verdicts : Counter of Verdict
        How often each verdict was given.
    answered : int
        The newest sample that has an accepted answer.
    """

    def __init__(self) -> None:
        self.verdicts: Counter[Verdict] = Counter()
        self.answered = 0
        self._last: Command | None = None
        self._has_rival = False

    def release(self) -> None:
        """Forget the commander: it is silent."""
        self._last = None
        self._has_rival = False

    def judge(self, command: Command, newest: int) -> Verdict:
        """Tell what becomes of a command.

        Parameters
        ----------
        command : Command
            The command.
        newest : int
            Number of the newest sample.

        Returns
        -------
        Verdict
            Only an accepted command may act.
        """
        verdict = self._verdict(command, newest)
        if verdict is Verdict.FOREIGN:
            self._has_rival = True
        if verdict is Verdict.ACCEPTED:
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
            return Verdict.ACCEPTED if command.state_sequence > self.answered else Verdict.OLD
        if command == last:
            return Verdict.DUPLICATE
        commands = command.sequence - last.sequence
        samples = command.state_sequence - last.state_sequence
        if samples == 0:
            return Verdict.CONFLICT
        # Also for what comes late: then both counts are negative.
        if not 1 <= commands * _sign(samples) <= abs(samples):
            return Verdict.FOREIGN
        return Verdict.ACCEPTED if samples > 0 else Verdict.OLD


def _sign(number: int) -> int:
    return 1 if number > 0 else -1

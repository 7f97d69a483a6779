"""Law in its loop: it hears what was sent, and is replaced without a jump of the command."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from flexarm_control.laws.law_protocol import NO_EFFORT, Effort, hearing, limited

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.law_protocol import DriveCommand, LawWithMemory, Memory

ASKED = "asked"
"""Group of the memory that is not in records made before laws heard what was sent."""
FADE_V = 0.1
"""Decrease of the difference between the old and the new command with every sample, V."""


class Handover:
    """Law that hears what was sent, and can be replaced between two samples.

    The first answer of a new law is the command in force. The difference to its own answer then
    fades linearly. It is part of the effort, so that the compensation keeps its meaning. From
    sample to sample the command changes at most by the change of the law's own answer plus
    `FADE_V`.

    Each sample has the command in force while it was taken. When that is not what was answered, a
    limit has cut it, it came too late or was lost, somebody else commands, or nobody does. The law
    hears the difference (`HearingLaw`).

    Parameters
    ----------
    law : LawWithMemory
        First law.
    rounding_v : float
        Commands that differ by no more are the same, V: those of a drive with other units have
        been converted there and back.
    """

    def __init__(self, law: LawWithMemory, rounding_v: float = 0.0) -> None:
        self.law, self._inform = law, hearing(law)
        self._rounding_v = rounding_v
        self._forget()

    def _forget(self) -> None:
        self._is_new, self._difference_v, self._command_v = False, 0.0, 0.0
        self._asked = NO_EFFORT
        self._own_v = self._before_v = 0.0
        self._has_asked = False

    def replace(self, law: LawWithMemory) -> None:
        """Take another law from the next sample on; the same law again changes nothing."""
        if law is not self.law:
            self.law, self._inform = law, hearing(law)
            self._is_new, self._has_asked = True, False

    def step(
        self, volts: Sequence[float], reference_v: float, drive: DriveCommand | None = None
    ) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`.

        Parameters
        ----------
        volts, reference_v
            See there.
        drive : DriveCommand, optional
            Command in force while the sample was taken; by default the last answer.
        """
        if drive is None or not isfinite(drive.command_v - drive.compensation_v):
            self._inform(0.0, 0.0)
        else:
            self._hear(drive)
        answer = self.law.step(volts, reference_v)
        if answer is NO_EFFORT:
            # The answer to a fault is zero, whatever the command was before.
            self._forget()
            return answer
        self._own_v, self._before_v, self._has_asked = answer.effort_v, sum(self._asked), True
        if self._is_new:
            self._is_new = False
            self._difference_v = self._command_v - sum(answer)
        elif self._difference_v:
            size_v = max(0.0, abs(self._difference_v) - FADE_V)
            self._difference_v = size_v if self._difference_v > 0.0 else -size_v
        if self._difference_v:
            answer = limited(answer.effort_v + self._difference_v, answer.compensation_v)
        self._asked, self._command_v = answer, sum(answer)
        return answer

    def _hear(self, drive: DriveCommand) -> None:
        """Tell the law what became of its last answer."""
        command_v, asked = drive.command_v, self._asked
        is_sent = abs(command_v - sum(asked)) <= self._rounding_v
        is_late = not is_sent and abs(command_v - self._before_v) <= self._rounding_v
        if not is_late:
            self._command_v = command_v
        if not self._has_asked:
            self._inform(0.0, 0.0)
            return
        sent_v = asked.effort_v if is_sent else command_v - drive.compensation_v
        self._inform(sent_v - self._own_v, 0.0 if is_late else asked.effort_v - sent_v)

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._forget()
        self.law.reset()

    def memory(self) -> Memory:
        """Return the fade and the memory of the law; see `LawWithMemory.memory`."""
        fade = (self._command_v, self._difference_v, float(self._is_new))
        asked = (*self._asked, self._own_v, self._before_v, float(self._has_asked))
        return {"handover": fade, ASKED: asked, **self.law.memory()}

    def remember(self, memory: Memory) -> None:
        """Go on from a fade and a memory of the law; see `LawWithMemory.remember`."""
        self._command_v, self._difference_v, is_new = memory["handover"]
        self._is_new = bool(is_new)
        if ASKED in memory:
            effort_v, compensation_v, self._own_v, self._before_v, has_asked = memory[ASKED]
            self._asked, self._has_asked = Effort(effort_v, compensation_v), bool(has_asked)
        self.law.remember(memory)

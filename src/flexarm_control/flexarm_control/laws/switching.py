"""Change of the law during a run without a jump of the command."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_control.laws.law_protocol import NO_EFFORT, Effort, limited

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.law_protocol import LawWithMemory, Memory

FADE_V = 0.1
"""Decrease of the difference between the old and the new command with every sample, V."""


class Handover:
    """Law that can be replaced between two samples.

    The first answer of a new law is the command in force. The difference to its own answer then
    fades linearly. It is part of the effort, so that the compensation keeps its meaning. From
    sample to sample the command changes at most by the change of the law's own answer plus
    `FADE_V`.

    Parameters
    ----------
    law : LawWithMemory
        First law.
    """

    def __init__(self, law: LawWithMemory) -> None:
        self.law = law
        self._command_v = 0.0
        self._difference_v = 0.0
        self._is_new = False

    def replace(self, law: LawWithMemory) -> None:
        """Take another law from the next sample on; the same law again changes nothing."""
        self._is_new = self._is_new or law is not self.law
        self.law = law

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        answer = self.law.step(volts, reference_v)
        if answer is NO_EFFORT:
            # The answer to a fault is zero, whatever the command was before.
            self._is_new, self._difference_v, self._command_v = False, 0.0, 0.0
            return answer
        if self._is_new:
            self._is_new = False
            self._difference_v = self._command_v - sum(answer)
        elif self._difference_v:
            size_v = max(0.0, abs(self._difference_v) - FADE_V)
            self._difference_v = size_v if self._difference_v > 0.0 else -size_v
        if self._difference_v:
            answer = limited(answer.effort_v + self._difference_v, answer.compensation_v)
        self._command_v = sum(answer)
        return answer

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._is_new, self._difference_v, self._command_v = False, 0.0, 0.0
        self.law.reset()

    def memory(self) -> Memory:
        """Return the fade and the memory of the law; see `LawWithMemory.memory`."""
        fade = (self._command_v, self._difference_v, float(self._is_new))
        return {"handover": fade, **self.law.memory()}

    def remember(self, memory: Memory) -> None:
        """Go on from a fade and a memory of the law; see `LawWithMemory.remember`."""
        self._command_v, self._difference_v, is_new = memory["handover"]
        self._is_new = bool(is_new)
        self.law.remember(memory)

"""Change of the law in the middle of a run without a bump of the command."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_control.laws.law_protocol import NO_EFFORT, Effort, Law, limited

if TYPE_CHECKING:
    from collections.abc import Sequence

FADE_V = 0.1
"""By how much the difference between the old and the new command shrinks with every sample."""


class Handover:
    """A law that can be replaced between two samples.

    The first answer of a new law is the command that was in force; the difference to its own
    answer then fades linearly. It is part of the effort, so that the compensation stays what it
    stands for. From sample to sample the command moves by no more than the law's own answer does,
    plus `FADE_V`.

    Parameters
    ----------
    law
        The law to begin with.
    """

    def __init__(self, law: Law) -> None:
        self.law = law
        self._command_v = 0.0
        self._difference_v = 0.0
        self._is_new = False

    def replace(self, law: Law) -> None:
        """Take another law from the next sample on; the same one again changes nothing.

        Parameters
        ----------
        law
            The new law, as before its first sample.
        """
        self._is_new = self._is_new or law is not self.law
        self.law = law

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        answer = self.law.step(volts, reference_v)
        if answer is NO_EFFORT:
            # A fault, or nothing to do: zero is then right, whatever was before.
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
        """Forget the past, as before the first sample."""
        self._is_new, self._difference_v, self._command_v = False, 0.0, 0.0
        self.law.reset()

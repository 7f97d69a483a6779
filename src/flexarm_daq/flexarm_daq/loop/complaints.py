"""Complaints about a running loop: commands that do not come, or are none, and lost periods."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from flexarm_daq.loop.commander import Verdict
from flexarm_daq.loop.limiter import LIMITS, NOT_FINITE

if TYPE_CHECKING:
    from flexarm_daq.loop.acquisition import Acquisition

_SILENT_S = 1.0
# Time without samples, of a second, that a user should know of.
_HELD_UP_S = 0.05
# Fewer commands than those of that time may all be limited in a move.
_LIMITED_S = 0.5
_MISSED, _LIMITED = "missed", "limited"


class Complaints:
    """Complaints about one run, by what its counts have become since the last look.

    Parameters
    ----------
    rate_hz : float
        Sampling rate, Hz.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._counts: Counter[object] = Counter()

    def look(self, loop: Acquisition) -> str:
        """Return what a user should know first, in one line; empty when all is well."""
        counts: Counter[object] = Counter({_MISSED: loop.missed, _LIMITED: loop.limited})
        counts.update(loop.commander.verdicts)
        counts.update(loop.limited_by)
        # What has not grown is not in the difference.
        new, self._counts = counts - self._counts, counts
        if loop.waits_s > _SILENT_S:
            return f"the arm's time stands: sample {loop.sequence} waits for its answer"
        return (
            self._silence(loop, new)
            or self._held_up(new[_MISSED])
            or self._limits(new)
            # The measured rate would make it another warning every second.
            or ("samples do not come at rate_hz: see off rate" if loop.off_rate else "")
        )

    def _silence(self, loop: Acquisition, new: Counter[object]) -> str:
        answered, verdicts = loop.commander.answered, loop.commander.verdicts
        is_awaited = answered or verdicts[Verdict.LATE] or verdicts[Verdict.FOREIGN]
        if not is_awaited or loop.sequence - answered < _SILENT_S * self._rate_hz:
            return ""
        if new[Verdict.FOREIGN]:
            return (
                "commands come and none is obeyed: their numbers (sequence) do not grow by one "
                "with each, as when one node does not count or two send; the drive is at zero"
            )
        since = f" since the one for sample {answered}" if answered else ""
        return f"no command in time{since}: the drive is at zero"

    def _held_up(self, missed: int) -> str:
        """Return how many periods the loop has missed, if they are many."""
        lost_s = missed / self._rate_hz
        if lost_s < _HELD_UP_S:
            return ""
        return f"{missed} periods without a sample, {lost_s:.2f} s in all: the loop was held up"

    def _limits(self, new: Counter[object]) -> str:
        if new[NOT_FINITE]:
            return "commands come that are not finite numbers: the drive is at zero for each"
        accepted = new[Verdict.ACCEPTED]
        if accepted < _LIMITED_S * self._rate_hz or new[_LIMITED] < accepted:
            return ""
        acting = ", ".join(name for name in LIMITS if new[name])
        return f"every command is limited, by {acting}: the commander asks for more than is allowed"

"""Complaints about a running loop: commands that do not come, or are none, and lost periods."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from flexarm_daq.loop.commander import Verdict
from flexarm_daq.loop.limiter import LIMITS, NOT_FINITE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexarm_daq.loop.acquisition import Acquisition

_SILENT_S = 1.0
# Time without samples, of a second, that a user should know of.
_HELD_UP_S = 0.05
# Fewer commands than those of that time may all be limited in a move.
_LIMITED_S = 0.5


class _Counts(NamedTuple):
    """Counts of a run up to a look."""

    missed: int = 0
    accepted: int = 0
    foreign: int = 0
    limited: int = 0


class Complaints:
    """Complaints about one run, by what its counts have become since the last look.

    Parameters
    ----------
    rate_hz : float
        Sampling rate, Hz.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._counts = _Counts()
        self._limited_by: Mapping[str, int] = {}

    def look(self, loop: Acquisition) -> str:
        """Return what a user should know first, in one line; empty when all is well."""
        verdicts = loop.commander.verdicts
        now = _Counts(
            loop.missed, verdicts[Verdict.ACCEPTED], verdicts[Verdict.FOREIGN], loop.limited
        )
        new = _Counts(*(count - before for count, before in zip(now, self._counts, strict=True)))
        limits = {name: loop.limited_by[name] - self._limited_by.get(name, 0) for name in LIMITS}
        self._counts, self._limited_by = now, dict(loop.limited_by)
        if loop.waits_s > _SILENT_S:
            return f"the arm's time stands: sample {loop.sequence} waits for its answer"
        return (
            self._silence(loop, new)
            or self._held_up(new.missed)
            or self._limits(new, limits)
            # The measured rate would make it another warning every second.
            or ("samples do not come at rate_hz: see off rate" if loop.off_rate else "")
        )

    def _silence(self, loop: Acquisition, new: _Counts) -> str:
        answered, verdicts = loop.commander.answered, loop.commander.verdicts
        is_awaited = answered or verdicts[Verdict.LATE] or verdicts[Verdict.FOREIGN]
        if not is_awaited or loop.sequence - answered < _SILENT_S * self._rate_hz:
            return ""
        if new.foreign:
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

    def _limits(self, new: _Counts, limits: Mapping[str, int]) -> str:
        if limits[NOT_FINITE]:
            return "commands come that are no finite numbers: the drive is at zero for each"
        if new.accepted < _LIMITED_S * self._rate_hz or new.limited < new.accepted:
            return ""
        acting = ", ".join(name for name, count in limits.items() if count)
        return f"every command is limited, by {acting}: the commander asks for more than is allowed"

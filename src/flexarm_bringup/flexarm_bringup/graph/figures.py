"""Figures that a running arm answers with: the set-point in force, and those of a run."""

from __future__ import annotations

import math
from typing import NamedTuple


class Run(NamedTuple):
    """Figures of a run that has ended, as the DAQ node reports them, and the recorder's report.

    `off_rate` is a measured rate that is not the one that was asked for, in words. `reply_s` is the
    median time from a sample to its command, s; NaN where there was none.
    """

    taken: int
    missed: int
    real_time_factor: float
    recorded: str = ""
    off_rate: str = ""
    reply_s: float = math.nan


class SetPoint(NamedTuple):
    """Set-point in force, and what a user should know of it; mostly nothing."""

    value: float
    note: str = ""

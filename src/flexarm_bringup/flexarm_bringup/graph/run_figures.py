"""Figures of a run of the loop that has ended."""

from __future__ import annotations

from typing import NamedTuple


class Run(NamedTuple):
    """Figures of a run that has ended, as the DAQ node reports them, and the recorder's report.

    `off_rate` is a measured rate that is not the one that was asked for, in words.
    """

    taken: int
    missed: int
    real_time_factor: float
    recorded: str = ""
    off_rate: str = ""

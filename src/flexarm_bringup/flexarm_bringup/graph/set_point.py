"""Set-point as the controller has answered."""

from __future__ import annotations

from typing import NamedTuple


class SetPoint(NamedTuple):
    """Set-point in force, and what a user should know of it; mostly nothing."""

    value: float
    note: str = ""

"""The error class at the boundary of this package."""

from __future__ import annotations


class ControlError(ValueError):
    """A gain, reference or model that cannot be used; the message names it and what to do."""

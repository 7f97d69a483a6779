"""What goes wrong in a reproduction, in one line."""

from __future__ import annotations

from flexarm_core.errors import FlexarmError


class ReproductionError(FlexarmError):
    """What was asked for cannot be run."""


def one_line(error: BaseException) -> str:
    """Return the kind of an error and its message."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}".removesuffix(": ")

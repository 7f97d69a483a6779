"""Width of what a test tries: `./flexarm test` tries a few, `./flexarm test --exhaustive` more."""

from __future__ import annotations

from typing import TypeVar

from hypothesis import settings

T = TypeVar("T")


def wide(few: T, many: T) -> T:
    """Return what this run tries of one kind: how many seeds or examples, or which."""
    return many if settings.get_current_profile_name() == "exhaustive" else few

"""Width of what a test tries: `./flexarm test` tries a few, `./flexarm test --exhaustive` more."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from collections.abc import Iterable

T = TypeVar("T")


def wide(few: T, many: T) -> T:
    """Return what this run tries of one kind: how many seeds or examples, or which."""
    return many if settings.get_current_profile_name() == "exhaustive" else few


def first_of(values: Iterable[object], few: int = 1) -> list[Any]:
    """Return values to parametrize with: those behind the first few are for `--exhaustive`."""
    every = [each if isinstance(each, tuple) else (each,) for each in values]
    rest = [pytest.param(*each, marks=pytest.mark.exhaustive) for each in every[few:]]
    return [*(pytest.param(*each) for each in every[:few]), *rest]

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.acquisition_bench import Clock, acquisition_clock

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def clock() -> Iterator[Clock]:
    """Return the clock by which the acquisition goes."""
    with acquisition_clock() as made:
        yield made

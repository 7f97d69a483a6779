from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.browser import CHROMIUM, Browser
from support.live_mock import LiveMock

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("the page is tried in Chromium, which is not here")
    with Browser() as started:
        yield started


@pytest.fixture
def mock() -> Iterator[LiveMock]:
    with LiveMock(rate_hz=500.0) as served:
        yield served

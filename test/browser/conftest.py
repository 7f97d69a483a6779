from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.browser import CHROMIUM, Browser
from support.live_mock import LiveMock

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("the page is tried in Chromium, which is not here")
    with Browser() as started:
        yield started


@pytest.fixture
def browser(chromium: Browser) -> Iterator[Browser]:
    yield chromium
    # A page that is left open draws on beside the tests of the next quarter of an hour.
    chromium.call("Page.navigate", url="about:blank")


@pytest.fixture
def mock() -> Iterator[LiveMock]:
    with LiveMock(rate_hz=500.0) as served:
        yield served

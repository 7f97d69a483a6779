"""The live page of a mock, opened in the browser."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from support.browser import Browser
    from support.live_mock import LiveMock


def opened(browser: Browser, mock: LiveMock, *, width: int = 1400, dark: bool = False) -> None:
    """Open the page and wait for the first sample that it draws."""
    browser.open(mock.address, width=width, dark=dark)
    browser.wait_for("document.getElementById('arm').dataset.angleDeg !== undefined")


def asked(mock: LiveMock, verb: str) -> list[dict[str, object]]:
    """Return what the pages asked for with a verb."""
    return [request for request in mock.requests if request["do"] == verb]

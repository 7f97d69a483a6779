"""Laboratory as the server sees it: the graph behind a bridge, or a double in a test."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from flexarm_live.serving.requests import Request


class Answer(NamedTuple):
    """Answer to a request that was carried out."""

    message: str = ""
    data: Mapping[str, Any] | None = None


class Laboratory(Protocol):
    """What the server asks for; all of it in the server's own thread."""

    async def hello(self) -> Mapping[str, Any]:
        """Return what does not change: channels, laws, experiments, parameters."""

    def state(self) -> Mapping[str, Any]:
        """Return the state of now."""

    def reports(self) -> Mapping[str, Any]:
        """Return message and figures of each node that reports."""

    async def carry_out(self, request: Request) -> Answer:
        """Carry out a request; a `FlexarmError` refuses it with a reason."""

    def place_for(self, name: str) -> Path:
        """Return where a dropped file goes; a `FlexarmError` refuses its name with a reason."""

    def report(self, name: str) -> bytes | None:
        """Return a page by its address below the reports; None when there is none."""


class Outlet(Protocol):
    """What the laboratory may call when it has news. Any thread may call."""

    def send(self, message: Mapping[str, Any]) -> None:
        """Send a message to every client."""

    def send_state(self) -> None:
        """Send the state of now to every client."""

    def send_samples(self, frame: bytes) -> None:
        """Send a frame of samples to every page."""

    @property
    def pages(self) -> int:
        """How many pages are open."""

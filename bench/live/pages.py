"""Pages in Chromium, and clients that read nothing."""

from __future__ import annotations

import os
import socket
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.live.laboratory import Laboratory
    from support.browser import Browser

_PROBE = (Path(__file__).parent / "probe.js").read_text("utf-8")
_HANDSHAKE = (
    "GET {0.path}?{0.query} HTTP/1.1\r\nHost: {0.netloc}\r\nUpgrade: websocket\r\n"
    "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
)
_SMALL_BUFFER = 4096
_COUNT_FRAMES = """void (window.framesSeen = 0, (function see() {
  framesSeen += 1;
  requestAnimationFrame(see);
})())"""


@contextmanager
def tabs(browser: Browser, lab: Laboratory, count: int) -> Iterator[None]:
    """Show the page in so many tabs of a browser: one in front, the others behind it."""
    browser.open(lab.address)
    await_arm(browser)
    calm(browser)
    others = [
        browser.call("Target.createTarget", url=lab.address)["targetId"] for _ in range(count - 1)
    ]
    browser.call("Page.bringToFront")
    try:
        yield
    finally:
        for target in others:
            browser.call("Target.closeTarget", targetId=target)
        browser.call("Page.navigate", url="about:blank")


@contextmanager
def probed(browser: Browser, lab: Laboratory) -> Iterator[None]:
    """Show the page with the probe in it."""
    added = browser.call("Page.addScriptToEvaluateOnNewDocument", source=_PROBE)
    browser.open(lab.address)
    await_arm(browser)
    calm(browser)
    try:
        yield
    finally:
        browser.call("Page.removeScriptToEvaluateOnNewDocument", **added)
        browser.call("Page.navigate", url="about:blank")


def await_arm(browser: Browser) -> None:
    """Wait until the page has drawn the arm."""
    browser.wait_for("document.getElementById('arm').dataset.angleDeg !== undefined")


def calm(browser: Browser) -> None:
    """Let the browser report no more of what it receives: that costs more than the page."""
    browser.call("Network.disable")


def empty_frames_per_s(browser: Browser, length_s: float) -> float:
    """Return how many frames a second an empty page has: no page has more here."""
    browser.call("Page.navigate", url="about:blank")
    browser.wait_for("location.href === 'about:blank'")
    browser.ask(_COUNT_FRAMES)
    first, start_s = browser.ask("framesSeen"), time.monotonic()
    time.sleep(length_s)
    seen: int = browser.ask("framesSeen") - first
    return seen / (time.monotonic() - start_s)


@contextmanager
def silent_client(lab: Laboratory) -> Iterator[int]:
    """Connect as a page that reads the answer to its handshake and nothing more.

    The port of the client is yielded.
    """
    address = urlsplit(lab.socket_url)
    assert address.hostname is not None  # noqa: S101 - the server's own address
    with socket.socket() as client:
        # The system shall not take it all in its place.
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _SMALL_BUFFER)
        client.connect((address.hostname, address.port))
        client.sendall(_HANDSHAKE.format(address).encode())
        answer = b""
        while not answer.endswith(b"\r\n\r\n"):
            answer += client.recv(1)
        yield client.getsockname()[1]


def is_served(lab: Laboratory, client_port: int) -> bool:
    """Return whether the live node holds its end of a connection; the client needs not look."""
    ports = urlsplit(lab.socket_url).port, client_port
    for line in Path("/proc/net/tcp").read_text("utf-8").splitlines()[1:]:
        _, local, remote, *_, inode = line.split()[:10]
        # The end that a process has let go has no inode any more.
        if inode != "0" and (_port(local), _port(remote)) == ports:
            return True
    return False


def _port(address: str) -> int:
    return int(address.partition(":")[2], 16)


def resident_mb(pid: int) -> float:
    """Return the memory that a process holds, MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text("utf-8").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

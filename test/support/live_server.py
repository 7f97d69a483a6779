"""The live server over a laboratory in memory, with clients that speak to it over its sockets."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from flexarm_core.errors import FlexarmError
from flexarm_live.page_files import page_files
from flexarm_live.serving.access import LOOPBACK
from flexarm_live.serving.encoding import HEAD
from flexarm_live.serving.laboratory import Answer
from flexarm_live.serving.server import Server
from flexarm_live.serving.web import Web
from flexarm_live.terminal_socket import listen

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from flexarm_core.arrays import FloatArray
    from flexarm_live.graph.store import Store
    from flexarm_live.serving.requests import Request

TOKEN = "the-token-of-this-test"  # noqa: S105 - of a test
PATIENCE_S = 120.0


class MemoryLaboratory:
    """Laboratory that notes what it is asked; `slow` requests wait until `let_on`."""

    def __init__(self) -> None:
        self.asked: list[Request] = []
        self.withdrawn: list[str] = []
        self.slow = {"activate"}
        self.let_on = asyncio.Event()
        self.store: Store | None = None

    async def hello(self) -> Mapping[str, Any]:
        """Return a little of what a page is told."""
        return {"rate_hz": 300.0}

    def state(self) -> Mapping[str, Any]:
        """Return a state with a figure that is none."""
        return {"badge": "READY", "late_ms": {"p50": float("nan")}}

    def reports(self) -> Mapping[str, Any]:
        """Return the report of one node."""
        return {"daq": {"message": "active", "values": {"drive": "ready"}}}

    async def carry_out(self, request: Request) -> Answer:
        """Note a request; the law of the name `none` is refused."""
        if request.verb in self.slow:
            try:
                await self.let_on.wait()
            except asyncio.CancelledError:
                self.withdrawn.append(request.verb)
                raise
        self.asked.append(request)
        if request.fields.get("name") == "none":
            raise FlexarmError("law = 'none': must be one of pd, pdpc")
        return Answer("done", {"verb": request.verb})

    def place_for(self, name: str) -> Path:
        """Return where a dropped file goes."""
        assert self.store is not None
        return self.store.place_for(name)

    def report(self, name: str) -> bytes | None:
        """Return the one report."""
        return b"<!DOCTYPE html>" if name == "arm" else None


class LiveServer:
    """A server at work in a thread of its own."""

    def __init__(self, laboratory: MemoryLaboratory, namespace: str, *, view_only: bool) -> None:
        self.laboratory = laboratory
        self.namespace = namespace
        page = socket.create_server(("127.0.0.1", 0))
        self.port: int = page.getsockname()[1]
        web = Web(page_files(), LOOPBACK, TOKEN, view_only=view_only, report=laboratory.report)
        self.server = Server(laboratory, web, page, listen(namespace), ping_s=None)

    def page(self, query: str = f"?token={TOKEN}", **options: Any) -> ClientConnection:  # noqa: ANN401
        """Return a page that is connected."""
        address = f"ws://127.0.0.1:{self.port}/live{query}"
        page: ClientConnection = connect(
            address,
            compression=None,
            open_timeout=PATIENCE_S,
            ping_interval=None,
            close_timeout=2.0,
            **options,
        )
        return page

    def get(self, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
        """Return status, headers and body of a file, by a request that may be a hostile one."""
        head = {"Host": f"127.0.0.1:{self.port}", **headers}
        lines = [f"GET {path} HTTP/1.1", *(f"{key}: {value}" for key, value in head.items())]
        answer = self.raw("\r\n".join([*lines, "", ""]).encode())
        start, _, body = answer.partition(b"\r\n\r\n")
        status, *rows = start.decode().split("\r\n")
        return int(status.split()[1]), dict(row.split(": ", 1) for row in rows), body

    def raw(self, sent: bytes) -> bytes:
        """Send bytes and return all that comes until the server closes the connection."""
        with socket.create_connection(("127.0.0.1", self.port), PATIENCE_S) as connection:
            connection.sendall(sent)
            return b"".join(iter(lambda: connection.recv(65536), b""))


@contextmanager
def live_server(
    laboratory: MemoryLaboratory | None = None, *, view_only: bool = False
) -> Iterator[LiveServer]:
    """Yield a server with its thread; the caller has set a folder of its own for the socket."""
    live = LiveServer(laboratory or MemoryLaboratory(), "/arm", view_only=view_only)
    thread = threading.Thread(target=live.server.run, daemon=True)
    thread.start()
    try:
        yield live
    finally:
        live.server.stop()
        thread.join(PATIENCE_S)
        assert not thread.is_alive()


def ask(page: ClientConnection, **request: Any) -> dict[str, Any]:  # noqa: ANN401
    """Send a request to a page's server and return the reply to it."""
    page.send(json.dumps({"id": 7, **request}))
    return reply_to(page, 7)


def reply_to(page: ClientConnection, number: int) -> dict[str, Any]:
    """Return the reply to a request that was sent."""
    while True:
        message = received(page)
        if message["type"] == "reply" and message["id"] == number:
            return message


def received(page: ClientConnection) -> dict[str, Any]:
    """Return the next message in JSON."""
    while not isinstance(text := page.recv(PATIENCE_S), str):
        pass
    message: dict[str, Any] = json.loads(text)
    return message


def until_closed(page: ClientConnection) -> tuple[int | None, str | None]:
    """Take messages until the server closes a page; return its code and its reason, if it came."""
    with suppress(ConnectionClosed):
        while True:
            page.recv(PATIENCE_S)
    return page.protocol.close_code, page.protocol.close_reason


def until(condition: Callable[[], bool]) -> None:
    """Wait for a condition; fail when it does not come."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def frame_after(page: ClientConnection, wanted: Any) -> FloatArray:  # noqa: ANN401 - any condition
    """Return the first frame of samples for which a condition holds."""
    while True:
        message = page.recv(PATIENCE_S)
        if isinstance(message, bytes):
            _, rows, columns, _, _ = HEAD.unpack_from(message)
            frame = np.frombuffer(message, "<f4", offset=HEAD.size).reshape(rows, columns)
            if wanted(frame):
                return frame

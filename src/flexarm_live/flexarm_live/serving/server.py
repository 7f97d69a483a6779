"""Server of the page and of the terminal: HTTP, WebSocket and a Unix socket in one event loop."""

from __future__ import annotations

import asyncio
import logging
import time
from contextlib import suppress
from itertools import count
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs

from websockets.asyncio.server import serve
from websockets.exceptions import ConnectionClosed

from flexarm_live.serving.access import Role, role_of
from flexarm_live.serving.desk import (
    LARGEST_MESSAGE,
    MOST_A_SECOND,
    MOST_CLIENTS,
    Desk,
    Outbox,
    RateLimit,
    is_withdrawable,
)
from flexarm_live.serving.encoding import as_json
from flexarm_live.serving.web import DROP, STOP, address_of

if TYPE_CHECKING:
    import socket
    from asyncio import StreamReader, StreamWriter
    from collections.abc import Callable, Mapping

    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

    from flexarm_live.serving.laboratory import Laboratory
    from flexarm_live.serving.web import Web

_STATE_S = 0.5
_PING_S = 10.0
_GONE_S = 0.1
_POLICY_VIOLATION = 1008


class _Page:
    """Open page, with what waits for it."""

    def __init__(self, name: str, role: Role, connection: ServerConnection) -> None:
        self.name = name
        self.role = role
        self.at_work: set[asyncio.Task[None]] = set()
        self._connection = connection
        self._outbox = Outbox()
        self._news = asyncio.Event()

    def post(self, message: str | bytes) -> None:
        """Let a message wait for the page; one that takes none any more is cut off."""
        if self._outbox.put(message):
            self._news.set()
        else:
            self._connection.transport.abort()

    async def send(self) -> None:
        """Send what waits, as fast as the page takes it, until it goes away."""
        with suppress(ConnectionClosed):
            while True:
                await self._news.wait()
                self._news.clear()
                while self._outbox:
                    await self._connection.send(self._outbox.take())


class Server:
    """Server of one laboratory; its methods that send may be called from any thread.

    Parameters
    ----------
    laboratory : Laboratory
        What carries out the requests.
    web : Web
        Answers to requests for files.
    page : socket
        Listening socket of the page.
    terminal : socket
        Listening socket of the terminal.
    ping_s : float or None
        A page that does not answer for that time is dropped; None: it is waited for.
    """

    def __init__(
        self,
        laboratory: Laboratory,
        web: Web,
        page: socket.socket,
        terminal: socket.socket,
        *,
        ping_s: float | None = _PING_S,
    ) -> None:
        self._ping_s = ping_s
        self._web = web
        self._page, self._terminal = page, terminal
        host, port = page.getsockname()[:2]
        self.address = f"http://{host}:{port}/" + ("" if web.view_only else f"#token={web.token}")
        self._desk = Desk(laboratory, self.address, self._send_state)
        self._pages: set[_Page] = set()
        self._stops: set[_Page] = set()
        self._terminals: set[asyncio.Task[None]] = set()
        self._numbers = count(1)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopping: asyncio.Event | None = None

    @property
    def pages(self) -> int:
        """How many pages are open."""
        return len(self._pages)

    @property
    def holder(self) -> str:
        """Who has control of the set-point; empty when nobody has."""
        return self._desk.hold.holder

    def run(self) -> None:
        """Serve until `stop`, in the calling thread."""
        asyncio.run(self._serve())

    def stop(self) -> None:
        """End `run`."""
        self.call(lambda: self._stopping.set() if self._stopping else None)

    def send(self, message: Mapping[str, Any]) -> None:
        """Send a message to every page."""
        self._post(as_json(message))

    def send_state(self) -> None:
        """Send the state of now to every page."""
        self.call(self._send_state)

    def send_samples(self, frame: bytes) -> None:
        """Send a frame of samples to every page."""
        self._post(frame)

    def _post(self, message: str | bytes) -> None:
        def post() -> None:
            for page in self._pages:
                page.post(message)

        self.call(post)

    def call(self, action: Callable[[], object]) -> None:
        """Have the server's thread call a function."""
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(action)

    def _send_state(self) -> None:
        for each in self._pages:
            each.post(as_json(self._desk.state(each.name)))

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._stopping = asyncio.Event()
        # What others send wrong is not news for the log.
        silent = logging.getLogger("flexarm_live.connections")
        silent.propagate = False
        silent.addHandler(logging.NullHandler())
        pages = serve(
            self._on_page,
            sock=self._page,
            process_request=self._on_request,
            max_size=LARGEST_MESSAGE,
            compression=None,
            open_timeout=5.0,
            close_timeout=1.0,
            ping_interval=self._ping_s,
            ping_timeout=self._ping_s,
            server_header=None,
            logger=silent,
        )
        # `start_unix_server` of Python 3.13 looks for the file by the name that it was bound with.
        terminals = await asyncio.start_server(
            self._on_terminal, sock=self._terminal, limit=LARGEST_MESSAGE
        )
        async with pages:
            ticking = asyncio.create_task(self._tick())
            await self._stopping.wait()
            ticking.cancel()
            terminals.close()
            for task in self._terminals:
                task.cancel()

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(_STATE_S)
            self._send_state()

    def _on_request(self, _: ServerConnection, request: Request) -> Response | None:
        others = self._stops if request.path.startswith(STOP) else self._pages
        return self._web.answer(request, has_room=len(others) < MOST_CLIENTS)

    async def _on_page(self, connection: ServerConnection) -> None:
        request = connection.request
        assert request is not None  # noqa: S101 - answered before
        address = address_of(request)
        role = role_of(address.query, self._web.token, view_only=self._web.view_only)
        page = _Page(f"page {next(self._numbers)}", role or Role.VIEWER, connection)
        if address.path == STOP:
            # It gets nothing but the answers of its stops.
            await self._attend(page, connection, self._stops)
            return
        if address.path == DROP:
            await self._on_drop(page, connection, parse_qs(address.query).get("name", [""])[0])
            return
        page.post(as_json(await self._desk.hello(page.role)))
        page.post(as_json(self._desk.state(page.name)))
        await self._attend(page, connection, self._pages)

    async def _attend(self, page: _Page, connection: ServerConnection, among: set[_Page]) -> None:
        """Answer a page until it leaves."""
        among.add(page)
        sending = asyncio.create_task(page.send())
        try:
            with suppress(ConnectionClosed):
                await self._listen(page, connection)
        finally:
            among.discard(page)
            sending.cancel()
            self._desk.leave(page.name)

    async def _on_drop(self, page: _Page, connection: ServerConnection, name: str) -> None:
        """Write a file that is dropped on the page, and answer once."""
        with suppress(ConnectionClosed):
            reply = await self._desk.take_file(connection, name, page.role)
            await connection.send(as_json(reply))

    async def _listen(self, page: _Page, connection: ServerConnection) -> None:
        rate = RateLimit()
        async for text in connection:
            if not rate.allows(time.monotonic()):
                reason = f"more than {MOST_A_SECOND} messages a second"
                await connection.close(_POLICY_VIOLATION, reason)
                return
            # A stop must not wait for what takes long.
            task = asyncio.create_task(self._answer(page, text, len(page.at_work)))
            page.at_work.add(task)
            task.add_done_callback(page.at_work.discard)

    async def _answer(self, page: _Page, text: str | bytes, at_work: int) -> None:
        reply = await self._desk.answer(text, page.name, page.role, at_work=at_work)
        page.post(as_json(reply))

    async def _on_terminal(self, reader: StreamReader, writer: StreamWriter) -> None:
        """Answer the lines of a terminal, one after the other."""
        task = asyncio.current_task()
        assert task is not None  # noqa: S101 - this is one
        self._terminals.add(task)
        name = f"terminal {next(self._numbers)}"
        try:
            # A line that is too long is a ValueError, and ends the connection. One that waits ends
            # with the server, which is not news for the log.
            with suppress(ValueError, OSError, asyncio.CancelledError):
                while line := await reader.readline():
                    reply = await self._unless_gone(reader, line, name)
                    if reply is None:
                        return
                    writer.write(f"{as_json(reply)}\n".encode())
                    await writer.drain()
        finally:
            self._terminals.discard(task)
            self._desk.leave(name)
            writer.close()

    async def _unless_gone(
        self, reader: StreamReader, line: bytes, name: str
    ) -> dict[str, Any] | None:
        """Return the reply to a line; None when its terminal goes away before.

        What was asked for is withdrawn then: the terminal has reported a failure to its user, and a
        node that is started later must not get it. A stop is not.
        """
        work = asyncio.create_task(self._desk.answer(line, name, Role.OWNER))
        try:
            while not work.done():
                await asyncio.wait({work}, timeout=_GONE_S)
                if not work.done() and reader.at_eof() and is_withdrawable(line):
                    return None
            return work.result()
        finally:
            work.cancel()

"""Desk where every request of every client is answered, with its rights checked."""

from __future__ import annotations

import asyncio
import logging
import tempfile
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexarm_core.errors import FlexarmError, one_line, reason
from flexarm_core.outputs import OutputError
from flexarm_live.serving.access import Role
from flexarm_live.serving.laboratory import Answer
from flexarm_live.serving.requests import Needs, RequestError, parse

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from websockets.asyncio.server import ServerConnection

    from flexarm_live.serving.laboratory import Laboratory
    from flexarm_live.serving.requests import Request

_LOGGER = logging.getLogger("flexarm_live")
VERSION = 1
"""Version of what is said between server and page."""
_SILENT_S = 10.0
LARGEST_MESSAGE = 64_000
LARGEST_FILE = 200_000_000
"""Bytes of a file that is dropped on the page, in messages of the above size."""
MOST_A_SECOND = 200
MOST_WAITING = 4_000_000
"""Bytes that wait for a client before it is dropped, beside the buffers of the system."""
MOST_CLIENTS = 16
MOST_AT_WORK = 16
"""Requests of one client that are at work at a time."""


class Hold:
    """Hand on the set-point.

    Attributes
    ----------
    holder : str
        Name of the client that has it; empty when nobody has.
    """

    def __init__(self) -> None:
        self.holder = ""

    def take(self, client: str) -> None:
        """Give it to a client, which may have it already.

        Raises
        ------
        RequestError
            When another one has it.
        """
        if self.holder and self.holder != client:
            raise RequestError(f"{self.holder} has control of the set-point: it has to release it")
        self.holder = client

    def let_go(self, client: str) -> bool:
        """Take it from a client; return whether the client had it."""
        had = self.holder == client
        if had:
            self.holder = ""
        return had


class Desk:
    """Desk of one laboratory.

    Parameters
    ----------
    laboratory : Laboratory
        What carries out the requests.
    address : str
        Address of the page with its token, for the owner.
    on_hold : callable
        Called when control of the set-point has changed.

    Attributes
    ----------
    hold : Hold
        Control of the set-point.
    """

    def __init__(
        self, laboratory: Laboratory, address: str, on_hold: Callable[[], None] = lambda: None
    ) -> None:
        self._laboratory = laboratory
        self._address = address
        self._on_hold = on_hold
        self.hold = Hold()

    async def hello(self, role: Role) -> dict[str, Any]:
        """Return the first message to a client."""
        may_command = role is not Role.VIEWER
        about = await self._laboratory.hello()
        return {"type": "hello", "version": VERSION, "hand": may_command, **about}

    def state(self, client: str) -> dict[str, Any]:
        """Return the state of now as a client gets it."""
        holder = self.hold.holder
        return {
            "type": "state",
            **self._laboratory.state(),
            "holder": holder == client,
            "holder_name": "" if holder == client else holder,
        }

    def leave(self, client: str) -> None:
        """End the hold of a client that has gone; the arm stays where the law holds it."""
        if self.hold.let_go(client):
            self._on_hold()

    async def answer(
        self, text: str | bytes, client: str, role: Role, *, at_work: int = 0
    ) -> dict[str, Any]:
        """Carry out a request and return the reply, which says why when it is refused.

        Parameters
        ----------
        text : str or bytes
            The message.
        client, role : str, Role
            Name and rights of who sent it.
        at_work : int
            Other requests of the client that are being carried out.
        """
        number = 0
        try:
            request = parse(text)
            number = request.number
            _require_few(request, at_work)
            self._require(request, client, role)
            message, data = await self._carry_out(request, client)
        except RequestError as error:
            return _reply(error.number or number, ok=False, message=str(error))
        except FlexarmError as error:
            return _reply(number, ok=False, message=one_line(error))
        except Exception:
            _LOGGER.exception("a request failed")
            return _reply(number, ok=False, message="internal error, see the log of the node live")
        return _reply(number, ok=True, message=message, data=data)

    async def take_file(
        self, connection: ServerConnection, name: str, role: Role
    ) -> dict[str, Any]:
        """Take a file that is dropped on the page and return the reply with the record's name."""
        try:
            if role is Role.VIEWER:
                raise RequestError("this page may only look on; open the address with its token")
            await receive_file(connection, self._laboratory.place_for(name))
        except FlexarmError as error:
            return _reply(0, ok=False, message=one_line(error))
        return _reply(0, ok=True, message="", data={"bag": name.partition("/")[0]})

    def _require(self, request: Request, client: str, role: Role) -> None:
        """Refuse a client without the right, and give it control where it needs that."""
        if role is Role.OWNER or request.needs is Needs.NOTHING:
            return
        if request.needs is Needs.OWNER:
            raise RequestError(f"{request.verb}: only the terminal that started the page may ask")
        if role is Role.VIEWER:
            raise RequestError(
                f"{request.verb}: this page may only look on; open the address with its token"
            )
        if request.needs is Needs.HOLD:
            self._take(client)

    def _take(self, client: str) -> None:
        before = self.hold.holder
        self.hold.take(client)
        if not before:
            self._on_hold()

    async def _carry_out(self, request: Request, client: str) -> Answer:
        if request.verb == "hold":
            self._take(client)
            return Answer("you have control of the set-point")
        if request.verb == "let_go":
            self.leave(client)
            return Answer("nobody has control of the set-point" if not self.hold.holder else "")
        if request.verb == "address":
            return Answer(data={"url": self._address})
        if request.verb == "hello":
            return Answer(data=await self.hello(Role.OWNER))
        if request.verb == "status":
            return Answer(data={**self.state(client), "reports": self._laboratory.reports()})
        return await self._laboratory.carry_out(request)


def is_withdrawable(text: str | bytes) -> bool:
    """Return whether a request ends when who sent it has gone: any but a stop."""
    try:
        return parse(text).verb != "stop"
    except RequestError:
        return True


def _require_few(request: Request, at_work: int) -> None:
    if at_work >= MOST_AT_WORK and request.verb != "stop":
        raise RequestError(f"{at_work} requests of yours are at work: wait for a reply")


def _reply(
    number: int, *, ok: bool, message: str, data: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    return {"type": "reply", "id": number, "ok": ok, "message": message, "data": data or {}}


async def receive_file(
    connection: ServerConnection, place: Path, largest: int = LARGEST_FILE
) -> None:
    """Write the pieces of a file until a text ends it; it is in its place whole or not at all.

    Raises
    ------
    RequestError
        When it is larger than allowed, or nothing comes for long.
    OutputError
        When it cannot be written.
    ConnectionClosed
        When the page goes away.
    """
    size = 0
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        # A folder of its own beside it: on the same disk, and never taken for a record.
        with tempfile.TemporaryDirectory(prefix=".", dir=place.parent) as beside:
            part = Path(beside, "part")
            with part.open("wb") as file:  # noqa: ASYNC230 - it is empty
                while isinstance(piece := await _next(connection), bytes):
                    size += len(piece)
                    if size > largest:
                        raise RequestError(
                            f"{place.name} is larger than {largest / 1e6:g} MB: "
                            "identify it in a terminal, ./flexarm identify"
                        )
                    # A disk that is slow must not keep a stop waiting.
                    await asyncio.to_thread(file.write, piece)
            part.replace(place)  # noqa: ASYNC240 - a name alone
    except OSError as error:
        raise OutputError(f"{place.name} cannot be written: {reason(error)}") from error


async def _next(connection: ServerConnection) -> str | bytes:
    try:
        return await asyncio.wait_for(connection.recv(), _SILENT_S)
    except asyncio.TimeoutError as error:
        raise RequestError(f"nothing came for {_SILENT_S:g} s: drop the file again") from error


class RateLimit:
    """Count of the messages of one client in the last second."""

    def __init__(self, most: int = MOST_A_SECOND) -> None:
        self._times_s: deque[float] = deque(maxlen=most)

    def allows(self, now_s: float) -> bool:
        """Take one message; return whether it and those before are few enough."""
        times_s = self._times_s
        is_full = len(times_s) == times_s.maxlen and now_s - times_s[0] < 1.0
        times_s.append(now_s)
        return not is_full


class Outbox:
    """Messages that wait for one client, bounded by their size."""

    def __init__(self, most_bytes: int = MOST_WAITING) -> None:
        self._messages: deque[str | bytes] = deque()
        self._most_bytes = most_bytes
        self.waiting_bytes = 0

    def __bool__(self) -> bool:
        return bool(self._messages)

    def put(self, message: str | bytes) -> bool:
        """Add a message; return False, and leave it out, when there is no room."""
        if self.waiting_bytes + len(message) > self._most_bytes:
            return False
        self.waiting_bytes += len(message)
        self._messages.append(message)
        return True

    def take(self) -> str | bytes:
        """Return the oldest message, which no longer waits."""
        message = self._messages.popleft()
        self.waiting_bytes -= len(message)
        return message

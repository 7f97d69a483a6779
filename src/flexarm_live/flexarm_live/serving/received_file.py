"""File that comes over a WebSocket of its own, in pieces and then a text."""

from __future__ import annotations

import asyncio
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from flexarm_core.errors import reason
from flexarm_core.outputs import OutputError
from flexarm_live.serving.limits import LARGEST_FILE
from flexarm_live.serving.requests import RequestError

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection

_SILENT_S = 10.0


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

"""Page that looks on while a verb commands the arm."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from support.system_graph import PATIENCE_S


def looked_on(address: str) -> tuple[dict[str, Any], list[tuple[str, str]], int]:
    """Look on until the page is closed; return its greeting, its badges and how many frames."""
    shown, frames = [], 0
    with connect(f"{address.replace('http', 'ws', 1)}live", compression=None) as page:
        hello = json.loads(page.recv(PATIENCE_S))
        with suppress(ConnectionClosed):
            while True:
                message = page.recv(PATIENCE_S)
                if isinstance(message, bytes):
                    frames += 1
                    continue
                said = json.loads(message)
                if said["type"] == "state":
                    shown.append((said["badge"], said["reason"]))
    return hello, shown, frames

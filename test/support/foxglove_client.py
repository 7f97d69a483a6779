"""Client of the Foxglove WebSocket protocol, as a viewer speaks it.

The server tells its channels in JSON, the client subscribes by numbers of its own, and messages
come as binary frames: 1, the number, the time in nanoseconds, the bytes.
"""

from __future__ import annotations

import json
import struct
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, NamedTuple

from websockets.sync.client import connect
from websockets.typing import Subprotocol

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

_MESSAGE = 1
_HEAD = struct.Struct("<BIQ")


class Served(NamedTuple):
    """Message as it came."""

    topic: str
    time_ns: int
    raw: bytes


class FoxgloveClient:
    """Client that is connected.

    Parameters
    ----------
    port : int
        Port on the loopback interface.
    patience_s : float
        Longest time without a message.
    protocol : str
        Name of the protocol.

    Attributes
    ----------
    name : str
        Name of the server.
    capabilities : list of str
        What it takes from clients.
    channels : dict of str to dict
        What it has told of each topic.
    """

    def __init__(self, port: int, patience_s: float, protocol: str = "foxglove.sdk.v1") -> None:
        self._patience_s = patience_s
        self._stack = ExitStack()
        self._connection = self._stack.enter_context(
            connect(
                f"ws://127.0.0.1:{port}",
                subprotocols=[Subprotocol(protocol)],
                compression=None,
                max_size=None,
                ping_interval=None,
                open_timeout=patience_s,
            )
        )
        self.channels: dict[str, dict[str, Any]] = {}
        self._topics: list[str] = []
        reported = self._reported()
        self.name: str = reported["name"]
        self.capabilities: list[str] = reported["capabilities"]

    def close(self) -> None:
        """End the connection."""
        self._stack.close()

    def subscribe(self, topics: Iterable[str]) -> None:
        """Subscribe to topics, once the server has told of all of them."""
        wanted = list(topics)
        while not set(wanted) <= self.channels.keys():
            self._reported()
        first = len(self._topics)
        self._topics += wanted
        pairs = [
            {"id": number, "channelId": self.channels[topic]["id"]}
            for number, topic in enumerate(wanted, start=first)
        ]
        self._connection.send(json.dumps({"op": "subscribe", "subscriptions": pairs}))

    def messages(self) -> Iterator[Served]:
        """Yield messages; a TimeoutError when none comes for long."""
        while True:
            frame = self._connection.recv(self._patience_s)
            if isinstance(frame, bytes) and frame[0] == _MESSAGE:
                _, number, time_ns = _HEAD.unpack_from(frame)
                yield Served(self._topics[number], time_ns, frame[_HEAD.size :])

    def _reported(self) -> dict[str, Any]:
        """Return the next thing in JSON; channels are noted."""
        while not isinstance(text := self._connection.recv(self._patience_s), str):
            pass
        reported: dict[str, Any] = json.loads(text)
        self.channels |= {each["topic"]: each for each in reported.get("channels", [])}
        return reported

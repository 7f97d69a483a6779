"""Double of the part of `foxglove-sdk` that flexarm uses; it opens no port."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

TAKEN = 8999
"""Port that another program listens on."""


@dataclass
class Schema:
    """Definition of the messages of a channel."""

    name: str
    encoding: str
    data: bytes


@dataclass
class Context:
    """Channels by their topics."""

    channels: dict[str, Channel] = field(default_factory=dict)


class Channel:
    """Channel that keeps what is logged."""

    def __init__(
        self, topic: str, *, message_encoding: str, schema: Schema, context: Context
    ) -> None:
        self.topic = topic
        self.message_encoding = message_encoding
        self.schema = schema
        self.logged: list[tuple[bytes, int]] = []
        context.channels[topic] = self

    def log(self, raw: bytes, log_time: int) -> None:
        """Keep a message with its time."""
        self.logged.append((raw, log_time))


@dataclass
class Server:
    """Server with the arguments that it was started with."""

    settings: dict[str, Any]
    stopped: bool = False

    def stop(self) -> None:
        """Note the end."""
        self.stopped = True


SERVERS: list[Server] = []
"""Every server that was started."""


def start_server(**settings: Any) -> Server:  # noqa: ANN401
    """Return a server; a RuntimeError, as of the package, where the port is taken."""
    if settings["port"] == TAKEN:
        raise RuntimeError("FoxgloveError: Failed to bind port: Address already in use")
    SERVERS.append(Server(settings))
    return SERVERS[-1]

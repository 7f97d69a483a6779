"""Server of the Foxglove WebSocket protocol: topics as the bytes they are, with their definitions.

Foxglove, Lichtblick and PlotJuggler read it. It takes nothing from them: they can call no service,
set no parameter and publish nothing. The work is that of the Foxglove SDK, an optional package.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, NamedTuple

from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from flexarm_bags.schema import MessageDefinition

ADDRESS = "127.0.0.1"
USUAL_PORT = 8765
"""Port that the viewers propose."""
_WAITING = 30000
"""Messages that wait for a viewer: 20 s of a loop at 500 Hz. The oldest one gives way then."""


class _Message(NamedTuple):
    raw: bytes
    time_ns: int


def require_foxglove() -> None:
    """Raise a SettingError that names the remedy when the SDK, an optional package, is missing."""
    _sdk()


class FoxgloveServer:
    """Server of topics to viewers; its threads are the SDK's.

    Parameters
    ----------
    name : str
        Name that the viewers show.
    port : int
        Port on the loopback interface.
    definitions : mapping of str to MessageDefinition
        Topic -> definition of its messages.
    in_force : collection of str
        Topics whose last message is also for a viewer that comes later.

    Raises
    ------
    SettingError
        If the SDK is not installed or the port is taken.
    """

    def __init__(
        self,
        name: str,
        port: int,
        definitions: Mapping[str, MessageDefinition],
        in_force: Collection[str],
    ) -> None:
        sdk = _sdk()
        # Held here: its channels close with it.
        self._context = sdk.Context()
        self._channels = {
            topic: sdk.Channel(
                topic,
                message_encoding="cdr",
                schema=sdk.Schema(
                    name=definition.type_name, encoding="ros2msg", data=definition.text.encode()
                ),
                context=self._context,
            )
            for topic, definition in definitions.items()
        }
        self._last: dict[str, _Message | None] = dict.fromkeys(in_force)
        try:
            self._server = sdk.start_server(
                name=name,
                host=ADDRESS,
                port=port,
                server_listener=self,
                context=self._context,
                message_backlog_size=_WAITING,
            )
        except RuntimeError as error:
            raise SettingError(
                f"foxglove: cannot listen on {ADDRESS} port {port}: {error}"
            ) from None

    def send(self, topic: str, raw: bytes, time_ns: int) -> None:
        """Hand a message on to every viewer of its topic, and wait for none.

        Parameters
        ----------
        topic : str
            Name of one of the topics.
        raw : bytes
            Serialised message (CDR).
        time_ns : int
            Instant of publication, nanoseconds since the epoch.
        """
        if topic in self._last:
            self._last[topic] = _Message(raw, time_ns)
        self._channels[topic].log(raw, log_time=time_ns)

    def stop(self) -> None:
        """End the server."""
        self._server.stop()

    def on_subscribe(self, _: object, channel: Any) -> None:  # noqa: ANN401 - the SDK's
        """Send what is in force; those that have it already get it once more."""
        last = self._last.get(channel.topic)
        if last is not None:
            self._channels[channel.topic].log(last.raw, log_time=last.time_ns)

    def on_unsubscribe(self, _: object, __: object) -> None:
        """Do nothing: the SDK asks for this method."""


def _sdk() -> Any:  # noqa: ANN401 - a module that may be missing
    try:
        return importlib.import_module("foxglove")
    except ImportError:
        raise SettingError(
            "foxglove needs foxglove-sdk: pip install -r requirements/foxglove.in"
        ) from None

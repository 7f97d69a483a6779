"""Live node: serves the page in the browser, and answers the terminal.

It reads every sample of the rig and joins the graph as any other node does; the loop waits for
nothing here. Samples are taken from the middleware a few at a time and handed on as they are. The
process gives way to every other one.
"""

from __future__ import annotations

import asyncio
import secrets
import socket
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node

from flexarm_core.errors import SettingError
from flexarm_core.own_files import user_path
from flexarm_core.rig_description import load_rig
from flexarm_core.tables import read_table
from flexarm_live.graph.bridge import Bridge
from flexarm_live.graph.node_parameters import CallError
from flexarm_live.page_files import page_files
from flexarm_live.serving.access import LOOPBACK
from flexarm_live.serving.encoding import frame_of
from flexarm_live.serving.server import Server
from flexarm_live.serving.web import Web
from flexarm_live.terminal_socket import listen, socket_file
from flexarm_node import qos
from flexarm_node.parameter_files import LOOP
from flexarm_node.parameters import Parameters
from flexarm_node.process import run, yield_to_others
from flexarm_node.topics.waiting import RawTopicsWaiter

if TYPE_CHECKING:
    from collections.abc import Mapping

PARAMETERS = read_table("flexarm_live", "live")
_USUAL_PORT = 8117
_TOKEN_BYTES = 24
_FRAME_S = 1.0 / 60.0
_UNSEEN_S = 0.1
"""Between two looks at the samples while no page is open."""
_END_S = 5.0


class LiveNode(Node):
    """Node that connects the graph to a `Server`."""

    def __init__(self) -> None:
        super().__init__("live", namespace="/flexarm")
        values = Parameters(self, PARAMETERS).values()
        self._namespace = self.get_namespace()
        frame = f"{self._namespace}/base_link".lstrip("/")
        rig = load_rig(values["rig"])
        self._bridge = Bridge(self, user_path(values["folder"]).absolute(), rig, frame)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, qos.EVERY)
        self.create_subscription(
            ParameterEvent, "/parameter_events", self._on_parameters, qos.EVERY
        )
        self._looking: set[asyncio.Task[None]] = set()
        self._server = self._make_server(values)
        self._bridge.outlet = self._server
        # The set-point in force, and those of writers that tell nobody what they said before.
        codec = self._bridge.samples.codec
        references = [
            (codec.reference_type, codec.reference_topic, each) for each in (qos.STATUS, qos.EVERY)
        ]
        samples = (codec.samples.message_type, codec.sample_topic, qos.SEEN)
        self._waiter = RawTopicsWaiter(self, [samples, *references])
        self._stopping = threading.Event()
        self._threads = [
            threading.Thread(target=self._server.run, name="server"),
            threading.Thread(target=self._hand_on_samples, name="samples"),
        ]
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """End the server and its socket."""
        self._stopping.set()
        self._server.stop()
        for thread in self._threads:
            thread.join(_END_S)
        socket_file(self._namespace).unlink(missing_ok=True)

    def _make_server(self, values: Mapping[str, Any]) -> Server:
        address = values["address"]
        try:
            page = _listening(address, values["port"])
            terminal = listen(self._namespace)
        except OSError as error:
            raise SettingError(
                f"live: cannot listen on {address} port {values['port'] or _USUAL_PORT}: {error}"
            ) from None
        web = Web(
            page_files(),
            LOOPBACK | {address},
            secrets.token_urlsafe(_TOKEN_BYTES),
            view_only=values["view_only"],
            report=self._bridge.report,
        )
        return Server(self._bridge, web, page, terminal)

    def _hand_on_samples(self) -> None:
        """Hand every sample on, so many at once that a page hears 60 times a second.

        The loop comes before that. A stop does not wait: its threads have the usual priority.
        """
        yield_to_others()
        while not self._stopping.wait(_FRAME_S if self._server.pages else _UNSEEN_S):
            found = self._bridge.samples.read(self._waiter.wait(0.0))
            if found is None:
                continue
            self._bridge.situation.sampled(time.monotonic())
            if self._server.pages:
                self._server.send_samples(frame_of(*found))

    def _on_report(self, message: DiagnosticArray) -> None:
        for status in message.status:
            space, _, name = status.name.rpartition("/")
            if space == self._namespace.rstrip("/"):
                values = {each.key: each.value for each in status.values}
                # One byte in CDR.
                level = status.level[0] if isinstance(status.level, bytes) else status.level
                now_s = time.monotonic()
                is_new = self._bridge.situation.hear(name, level, status.message, values, now_s)
                if is_new and name in LOOP:
                    self._server.call(lambda node=name: self._begin_to_look_again(node))  # type: ignore[misc]

    def _begin_to_look_again(self, name: str) -> None:
        task = asyncio.create_task(self._look_again(name))
        self._looking.add(task)
        task.add_done_callback(self._looking.discard)

    async def _look_again(self, name: str) -> None:
        """Tell the pages what another process of a node has for parameters."""
        with suppress(CallError):
            self._send_parameters(name, await self._bridge.loop.parameters[name].look_again())

    def _send_parameters(self, name: str, changed: Mapping[str, Any]) -> None:
        if changed:
            self._server.send({"type": "parameters", "node": name, "values": changed})
            self._server.send_state()

    def _on_parameters(self, event: ParameterEvent) -> None:
        space, _, name = event.node.rpartition("/")
        if space != self._namespace.rstrip("/") or name not in LOOP:
            return
        changed = self._bridge.loop.parameters[name].update(
            [*event.new_parameters, *event.changed_parameters]
        )
        self._send_parameters(name, changed)


def _listening(address: str, port: int) -> socket.socket:
    """Return a listening socket of a port, or of the usual or any free one for 0."""
    if port == 0:
        with suppress(OSError):
            return socket.create_server((address, _USUAL_PORT))
    return socket.create_server((address, port))


def main() -> int:
    """Run the node."""
    return run(LiveNode)

"""Foxglove node: serves the topics of an arm to Foxglove, Lichtblick and PlotJuggler.

It reads as the recorder does, every message and its bytes alone, and hands them on. The process
gives way to every other one.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from rclpy.node import Node

from flexarm_core.tables import read_table
from flexarm_daq.nodes.recorded_topics import IN_FORCE, TOPICS, recorded_topics
from flexarm_live.serving.foxglove_server import ADDRESS, FoxgloveServer
from flexarm_node import qos
from flexarm_node.parameters import Parameters
from flexarm_node.process import give_way, run
from flexarm_node.topics.waiting import RawTopicsWaiter

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

PARAMETERS = read_table("flexarm_live", "foxglove")
_WAIT_S = 0.1
_END_S = 5.0


class FoxgloveNode(Node):
    """Node that connects the topics to a `FoxgloveServer`."""

    def __init__(self) -> None:
        super().__init__("foxglove", namespace="/flexarm")
        port = Parameters(self, PARAMETERS).values()["port"]
        names = list(TOPICS)
        self._topics = [self.resolve_topic_name(name) for name in names]
        served = recorded_topics(names, self._topics)
        self._server = FoxgloveServer(
            self.get_namespace(),
            port,
            {topic.name: topic.definition for topic in served},
            {topic for topic, name in zip(self._topics, names, strict=True) if name in IN_FORCE},
        )
        self._waiter = RawTopicsWaiter(
            self, [(TOPICS[name][0], name, _reader_qos(name)) for name in names]
        )
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._hand_on, name="messages")
        self._thread.start()
        self.get_logger().info(f"Foxglove, Lichtblick, PlotJuggler: ws://{ADDRESS}:{port}")

    def stop(self) -> None:
        """End the server."""
        self._stopping.set()
        self._thread.join(_END_S)
        self._server.stop()

    def _hand_on(self) -> None:
        while not self._stopping.is_set():
            for message in self._waiter.wait(_WAIT_S):
                self._server.send(self._topics[message.topic], message.raw, message.source_ns)


def _reader_qos(name: str) -> QoSProfile:
    """Return the QoS of the recorder, which starts first; here what is in force may be older."""
    return qos.STATUS_SENT if name in IN_FORCE else TOPICS[name][2]


def main() -> int:
    """Run the node."""
    give_way()
    return run(FoxgloveNode)

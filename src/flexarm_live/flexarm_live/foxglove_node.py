"""Foxglove node: serves the topics of an arm to Foxglove, Lichtblick and PlotJuggler.

It reads as the recorder does, every message and its bytes alone, and hands them on. For 3D panels
it adds the description of the arm and the frames of its links. The process gives way to every
other one.
"""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

from rclpy.node import Node

from flexarm_bags.schema import describe, own_types, share_of
from flexarm_core.errors import SettingError
from flexarm_core.own_files import user_path
from flexarm_core.rig_description import load_rig
from flexarm_core.tables import read_table
from flexarm_daq.nodes.recorded_topics import IN_FORCE, TOPICS, recorded_topics
from flexarm_live.serving.arm_frames import FRAMES_TYPE, TEXT_TYPE, ArmFrames, urdf_of
from flexarm_live.serving.foxglove_server import ADDRESS, FoxgloveServer
from flexarm_node import qos
from flexarm_node.parameters import Parameters
from flexarm_node.process import give_way, run
from flexarm_node.topics.waiting import RawTopicsWaiter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rclpy.qos import QoSProfile

PARAMETERS = read_table("flexarm_live", "foxglove")
_FRAMES = "/tf"
_WAIT_S = 0.1
_END_S = 5.0


class FoxgloveNode(Node):
    """Node that connects the topics to a `FoxgloveServer`."""

    def __init__(self) -> None:
        super().__init__("foxglove", namespace="/flexarm")
        values = Parameters(self, PARAMETERS).values()
        names = list(TOPICS)
        self._topics = [self.resolve_topic_name(name) for name in names]
        self._joint_states = self.resolve_topic_name("joint_states")
        description = self.resolve_topic_name("robot_description")
        served = {topic.name: topic.definition for topic in recorded_topics(names, self._topics)}
        in_force = {self.resolve_topic_name(name) for name in IN_FORCE}
        self._frames: ArmFrames | None = None
        if values["urdf"] or values["rig"]:
            prefix = f"{self.get_namespace()}/".lstrip("/")
            self._frames = ArmFrames(_urdf(values), prefix)
            types = own_types()
            served[description] = describe(types, TEXT_TYPE, share_of)
            served[_FRAMES] = describe(types, FRAMES_TYPE, share_of)
            in_force.add(description)
        self._server = FoxgloveServer(self.get_namespace(), values["port"], served, in_force)
        if self._frames is not None:
            self._server.send(description, self._frames.description(), time.time_ns())
        self._waiter = RawTopicsWaiter(
            self, [(TOPICS[name][0], name, _reader_qos(name)) for name in names]
        )
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._hand_on, name="messages")
        self._thread.start()
        self.get_logger().info(
            f"Foxglove, Lichtblick, PlotJuggler: ws://{ADDRESS}:{values['port']}"
        )

    def stop(self) -> None:
        """End the server."""
        self._stopping.set()
        self._thread.join(_END_S)
        self._server.stop()

    def _hand_on(self) -> None:
        while not self._stopping.is_set():
            for message in self._waiter.wait(_WAIT_S):
                topic = self._topics[message.topic]
                self._server.send(topic, message.raw, message.source_ns)
                if self._frames is not None and topic == self._joint_states:
                    transforms = self._frames.transforms(message.raw)
                    self._server.send(_FRAMES, transforms, message.source_ns)


def _urdf(values: Mapping[str, str]) -> str:
    """Return the URDF of the parameters: that of a file, or made of the rig's description."""
    if not values["urdf"]:
        return urdf_of(load_rig(values["rig"]))
    file = user_path(values["urdf"])
    try:
        return file.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SettingError(f"urdf = {file}: {error}") from None


def _reader_qos(name: str) -> QoSProfile:
    """Return the QoS of the recorder, which starts first; here what is in force may be older."""
    return qos.STATUS_SENT if name in IN_FORCE else qos.EVERY


def main() -> int:
    """Run the node."""
    give_way()
    return run(FoxgloveNode)

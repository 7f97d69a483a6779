"""The player: publishes the messages of a bag with their original timing, then ends."""

from __future__ import annotations

import importlib
import threading
import time
from pathlib import Path

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from flexarm_daq.playback import PlaybackError, PlaybackPlan, PlayedTopic
from flexarm_node.loop_node import wait_until
from flexarm_node.parameters import ParameterError, Parameters, ParameterSpec
from flexarm_node.process import request_stop, run

PARAMETERS = (
    ParameterSpec("bag", "", "rosbag2 folder or .mcap file", read_only=True),
    ParameterSpec("rate", 1.0, "2 plays twice as fast", 0.01, 1000.0, read_only=True),
    ParameterSpec("start_s", 0.0, "left out at the beginning", 0.0, 1e9, "s", read_only=True),
    ParameterSpec("duration_s", 0.0, "played; 0: to the end", 0.0, 1e9, "s", read_only=True),
    ParameterSpec("loop", default=False, description="start again at the end", read_only=True),
)


class PlayerNode(Node):
    """Wires a `PlaybackPlan` to publishers."""

    def __init__(self) -> None:
        super().__init__("player", namespace="/flexarm")
        values = Parameters(self, PARAMETERS).values()
        if not values["bag"]:
            raise ParameterError("parameter bag is empty: name the bag, -p bag:=FOLDER")
        try:
            self._plan = PlaybackPlan(
                Path(values["bag"]).expanduser(),
                rate=values["rate"],
                start_s=values["start_s"],
                duration_s=values["duration_s"] or None,
                loop=values["loop"],
            )
            topics = self._plan.topics()
        except PlaybackError as error:
            raise ParameterError(f"parameter bag: {error}") from None
        self._publishers_of = {
            topic.name: self.create_publisher(_message_type(topic), topic.name, _qos(topic))
            for topic in topics
        }
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._play, daemon=True, name="playing")
        self._thread.start()

    def stop(self) -> None:
        """End the play."""
        self._stopping.set()
        self._thread.join()

    def _play(self) -> None:
        wait_until(lambda: self._stopping.is_set() or self._is_heard())
        start_s = time.monotonic()
        count = 0
        try:
            for message in self._plan.messages():
                wait_s = start_s + message.due_s - time.monotonic()
                if self._stopping.wait(wait_s) if wait_s > 0 else self._stopping.is_set():
                    break
                self._publishers_of[message.topic].publish(message.raw)
                count += 1
        except PlaybackError as error:
            self.get_logger().error(str(error))
        self.get_logger().info(f"played {count} messages")
        request_stop()

    def _is_heard(self) -> bool:
        """Return whether somebody listens, and everybody who does is matched."""
        listeners = {topic: self.count_subscribers(topic) for topic in self._publishers_of}
        return any(listeners.values()) and all(
            publisher.get_subscription_count() >= listeners[topic]
            for topic, publisher in self._publishers_of.items()
        )


def _message_type(topic: PlayedTopic) -> type:
    package, _, name = topic.type_name.split("/")
    try:
        found: type = getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise ParameterError(
            f"parameter bag: {topic.name} has type {topic.type_name}, which is not installed"
        ) from None
    return found


def _qos(topic: PlayedTopic) -> QoSProfile:
    return QoSProfile(
        depth=topic.qos.depth,
        reliability=ReliabilityPolicy[topic.qos.reliability.upper()],
        durability=DurabilityPolicy[topic.qos.durability.upper()],
    )


def main() -> int:
    """Run the node."""
    return run(PlayerNode)

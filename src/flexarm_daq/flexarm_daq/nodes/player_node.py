"""Player node: publishes the messages of a bag with their original timing, then ends.

The node plays no topic that another node publishes: two sources of samples would move the arm. The
service `~/play` stops and starts it. It can stand in for the DAQ node and then publishes the
samples only, stamped and numbered as if they were taken now. A controller answers them, and a
recorder records both.
"""

from __future__ import annotations

import importlib
import struct
import threading
import time
from typing import TYPE_CHECKING

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from flexarm_bags.playback import PlaybackError, PlaybackPlan, PlayedTopic
from flexarm_core.errors import SettingError
from flexarm_core.own_files import user_path
from flexarm_core.tables import read_table
from flexarm_daq.nodes.play_clock import Pacer, StandIn
from flexarm_daq.nodes.recorded_topics import OF_ALL_NODES
from flexarm_node import qos
from flexarm_node.parameters import Parameters
from flexarm_node.process import request_stop, run
from flexarm_node.stamps import set_stamp
from flexarm_node.topics.waiting import await_acknowledged, has_every_reader, wait_until

if TYPE_CHECKING:
    from rclpy.publisher import Publisher

PARAMETERS = read_table("flexarm_daq.nodes", "player")

_CLOCK = "/clock"
_SAMPLES = frozenset({"flexarm_msgs/msg/ArmState", "flexarm_msgs/msg/IoSample"})
_STANDS_IN = _SAMPLES | {"flexarm_msgs/msg/ChannelInfo"}
# The middleware repeats an unheard announcement after 3 s: 0.1 s to 3.0 s were measured.
_DISCOVERY_S = 4.0


class PlayerNode(Node):
    """Node that connects a `PlaybackPlan` to publishers."""

    def __init__(self) -> None:
        super().__init__("player", namespace="/flexarm")
        values = Parameters(self, PARAMETERS).values()
        if not values["bag"]:
            raise SettingError("parameter bag is empty: name the bag, -p bag:=FOLDER")
        try:
            self._plan = PlaybackPlan(
                user_path(values["bag"]),
                rate=values["rate"],
                start_s=values["start_s"],
                duration_s=values["duration_s"] or None,
                loop=values["loop"],
            )
            topics = self._plan.topics()
        except PlaybackError as error:
            raise SettingError(f"parameter bag: {error}") from None
        if values["stand_in"]:
            topics = tuple(topic for topic in topics if topic.type_name in _STANDS_IN)
            if not topics:
                raise SettingError(f"parameter bag: {self._plan.bag} has no samples")
        self._samples = frozenset(
            topic.name for topic in topics if values["stand_in"] and topic.type_name in _SAMPLES
        )
        self._publishers_of = {
            topic.name: self.create_publisher(_message_type(topic), topic.name, _qos(topic))
            for topic in topics
        }
        self._clock: Publisher[Clock] | None = None
        # One in the bag is the better.
        if values["clock"] and _CLOCK not in self._publishers_of:
            self._clock = self.create_publisher(Clock, _CLOCK, qos.NEWEST)
            self._publishers_of[_CLOCK] = self._clock
        self._pacer = Pacer(running=False)
        self._stopping = threading.Event()
        self._listeners = values["listeners"]
        self._wanted = not values["stopped"]
        self._ready = threading.Event()
        self.failure = ""
        self.create_service(SetBool, "~/play", self._on_play)
        self._thread = threading.Thread(target=self._play, daemon=True, name="playing")
        self._thread.start()

    def stop(self) -> None:
        """End the play."""
        self._stopping.set()
        self._pacer.end()
        self._thread.join()

    def _play(self) -> None:
        self._stopping.wait(_DISCOVERY_S)
        publishers = list(self._publishers_of.values())
        wait_until(
            lambda: self._stopping.is_set() or has_every_reader(self, publishers, self._listeners)
        )
        self._ready.set()
        if self._wanted:
            self.failure = self._rivalry()
            if self.failure:
                self.get_logger().error(self.failure)
                request_stop()
                return
            self.get_logger().info("playing")
            self._pacer.start()
        start_ns = time.time_ns()
        stand_ins = {topic: StandIn(start_ns) for topic in self._samples}
        count = 0
        try:
            for due_s, topic, raw, time_ns in self._plan.messages():
                publisher = self._publishers_of.get(topic)
                if publisher is None:
                    continue
                if not self._pacer.wait_for(due_s):
                    break
                self._report_time(start_ns + round(due_s * 1e9) if stand_ins else time_ns)
                stand_in = stand_ins.get(topic)
                publisher.publish(raw if stand_in is None else stand_in.sample(raw, due_s))
                count += 1
        except (PlaybackError, struct.error) as error:
            self.get_logger().error(str(error))
        await_acknowledged(*publishers)
        self.get_logger().info(f"played {count} message{'s' * (count != 1)}")
        request_stop()

    def _report_time(self, time_ns: int) -> None:
        if self._clock is not None:
            now = Clock()
            set_stamp(now.clock, time_ns)
            self._clock.publish(now)

    def _on_play(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if request.data and not self._pacer.running:
            self._ready.wait()
            response.message = self._rivalry()
            if response.message:
                return response
        self._wanted = request.data
        if request.data:
            self._pacer.start()
        else:
            self._pacer.stop()
        response.success = True
        word = "playing" if request.data else "stopped"
        response.message = f"{word} at {self._pacer.position_s:.3f} s"
        return response

    def _rivalry(self) -> str:
        """Return the reason for a refusal: a topic that others publish; empty for none."""
        own = (self.get_namespace(), self.get_name())
        for topic, publisher in self._publishers_of.items():
            if topic in OF_ALL_NODES:
                continue
            infos = self.get_publishers_info_by_topic(topic)
            nodes = [(info.node_namespace, info.node_name) for info in infos]
            # The first node of that name is this one; a second one is another player.
            if own in nodes:
                nodes.remove(own)
            if nodes:
                names = ", ".join(sorted({f"{space.rstrip('/')}/{name}" for space, name in nodes}))
                return f"{publisher.topic_name} is published by {names}: stop it, then play"
        return ""


def _message_type(topic: PlayedTopic) -> type:
    package, _, name = topic.type_name.split("/")
    try:
        found: type = getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise SettingError(
            f"parameter bag: {topic.name} has type {topic.type_name}, which is not installed"
        ) from None
    return found


def _qos(topic: PlayedTopic) -> QoSProfile:
    """Return the QoS as recorded; a reader whose process pauses must lose nothing of a stream.

    A latched topic keeps its depth: that is what a latecomer gets.
    """
    durability = DurabilityPolicy[topic.qos.durability.upper()]
    is_stream = durability is DurabilityPolicy.VOLATILE
    return QoSProfile(
        depth=max(topic.qos.depth, qos.SENT.depth) if is_stream else topic.qos.depth,
        reliability=ReliabilityPolicy[topic.qos.reliability.upper()],
        durability=durability,
    )


def main() -> int:
    """Run the node; a refused play is an error of the process."""
    return run(PlayerNode)

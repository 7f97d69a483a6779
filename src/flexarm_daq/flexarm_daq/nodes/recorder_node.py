"""Recorder node: writes flexarm's topics into a bag that survives a crash.

The node records from its start when the parameter `bag` names a folder. The service `~/record`
starts and stops it. Every message gets the time at which it was published. A disk that refuses the
data ends the recording with an error, in the log and on `/diagnostics`, and has no other effect.
"""

from __future__ import annotations

import os
import queue
import threading
import time
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ament_index_python.packages import get_package_share_directory
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import Log, ParameterEvent
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

from flexarm_bags.metadata import RecordedTopic, TopicQos
from flexarm_bags.schema import describe, load_typestore
from flexarm_bags.writer import BagWriter, RecordingError
from flexarm_core.errors import SettingError
from flexarm_core.paths import user_path
from flexarm_core.specs import ParameterSpec
from flexarm_daq.nodes.kept_messages import KeptMessages
from flexarm_daq.nodes.send_times import SendTimes
from flexarm_msgs.msg import (
    ArmState,
    ChannelInfo,
    CommanderInfo,
    IoSample,
    LawInForce,
    MotorCommand,
    PayloadEstimate,
)
from flexarm_node import qos
from flexarm_node.node_time import NodeTime
from flexarm_node.parameters import Parameters
from flexarm_node.process import run
from flexarm_node.reports import Reporter
from flexarm_node.shares import share_of
from flexarm_node.waiting import RawMessage, RawTopicsWaiter

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rclpy.qos import QoSProfile

TOPICS = {
    "commander": (CommanderInfo, "flexarm_msgs/msg/CommanderInfo", qos.STATUS),
    "io_channels": (ChannelInfo, "flexarm_msgs/msg/ChannelInfo", qos.STATUS),
    "state": (ArmState, "flexarm_msgs/msg/ArmState", qos.EVERY),
    "command": (MotorCommand, "flexarm_msgs/msg/MotorCommand", qos.EVERY),
    "reference": (Float64, "std_msgs/msg/Float64", qos.EVERY),
    "law": (LawInForce, "flexarm_msgs/msg/LawInForce", qos.EVERY),
    "joint_states": (JointState, "sensor_msgs/msg/JointState", qos.EVERY),
    "io": (IoSample, "flexarm_msgs/msg/IoSample", qos.EVERY),
    "payload": (PayloadEstimate, "flexarm_msgs/msg/PayloadEstimate", qos.STATUS),
    "/diagnostics": (DiagnosticArray, "diagnostic_msgs/msg/DiagnosticArray", qos.EVERY),
    "/rosout": (Log, "rcl_interfaces/msg/Log", qos.EVERY),
    "/parameter_events": (ParameterEvent, "rcl_interfaces/msg/ParameterEvent", qos.EVERY),
}
"""Topics that can be recorded: message type, its name, QoS of the subscription.

Kept topics stand first: they are read before the samples that they describe.
"""

# What a latecomer is told: their publishers keep the last message.
_LATCHED = {"commander", "io_channels", "payload", "reference", "/rosout"}

PARAMETERS = (
    ParameterSpec("bag", "", "folder of the bag, to be created; empty: wait for the service"),
    ParameterSpec(
        "topics",
        ["commander", "state", "command", "reference", "law"],
        "which topics are recorded",
    ),
)
_WAIT_S = 0.1
# Longest time between the arrivals of two sent messages, on a busy machine too.
_QUIET_S = 0.5
_DRAIN_S = 5.0
_REPORT_S = 1.0


class RecorderNode(Node):
    """Node that connects topics to a `BagWriter`; one thread owns the bag, and services ask it."""

    def __init__(self) -> None:
        super().__init__("recorder", namespace="/flexarm")
        self._settings = Parameters(self, PARAMETERS, accept=_known_topics)
        wanted = _known_topics(self._settings.values())
        names = [name for name in TOPICS if name in wanted]
        self._names = [self.resolve_topic_name(name) for name in names]
        self._topics = _recorded_topics(names, self._names)
        self._waiter = RawTopicsWaiter(self, [(TOPICS[n][0], n, TOPICS[n][2]) for n in names])
        self._writer: BagWriter | None = None
        self._kept = KeptMessages(
            topic for topic, name in zip(self._names, names, strict=True) if _is_kept(name)
        )
        self._sent = [SendTimes() for _ in names]
        self._requests: queue.SimpleQueue[tuple[Callable[[], str], Future[str]]] = (
            queue.SimpleQueue()
        )
        self._stopping = threading.Event()
        self.failure = ""
        self._reporter = Reporter(self, NodeTime(self))
        self.create_timer(_REPORT_S, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.create_service(SetBool, "~/record", self._on_record)
        if self._settings.values()["bag"]:
            try:
                self._open()
            except RecordingError as error:
                raise SettingError(f"parameter bag: {error}") from None
        self._thread = threading.Thread(target=self._record, daemon=True, name="recording")
        self._thread.start()

    def stop(self) -> None:
        """Write the messages that have come so far and close the bag."""
        self._stopping.set()
        self._thread.join()

    def _record(self) -> None:
        while not self._stopping.is_set():
            messages = self._waiter.wait(_WAIT_S)
            received_ns = time.monotonic_ns()
            for message in messages:
                self._sent[message.topic].add(message.source_ns, received_ns)
            try:
                self._write(messages)
                if self._writer is not None:
                    # The topics may fall silent.
                    self._writer.flush_if_due()
            except RecordingError as error:
                self._fail(error)
            while not self._requests.empty():
                action, answer = self._requests.get()
                try:
                    answer.set_result(action())
                except RecordingError as error:
                    answer.set_exception(error)
        with suppress(RecordingError):
            self._close()

    def _fail(self, error: RecordingError) -> None:
        self._writer = None
        self.failure = f"recording stopped: {error}"
        self.get_logger().error(self.failure)

    def _write(self, messages: list[RawMessage]) -> None:
        for message in messages:
            name = self._names[message.topic]
            for topic, raw, time_ns in self._kept.due(name, message.raw, message.source_ns):
                if self._writer is not None:
                    self._writer.write(topic, raw, time_ns, time_ns)

    def _write_what_is_on_its_way(self) -> None:
        """Write every message that was sent before now and comes in time."""
        now_ns = time.monotonic_ns()
        deadline_s = time.monotonic() + _DRAIN_S
        while time.monotonic() < deadline_s:
            messages = self._waiter.wait(_QUIET_S)
            due = [
                message
                for message in messages
                if self._sent[message.topic].was_sent_before(message.source_ns, now_ns)
            ]
            self._write(due)
            if not due or due[-1] is not messages[-1]:
                return

    def _open(self) -> str:
        if self._writer is not None:
            raise RecordingError(f"already recording to {self._writer.path}")
        bag = self._settings.values()["bag"]
        if not bag:
            raise RecordingError("set the parameter bag to the folder to create")
        try:
            path = user_path(bag).absolute()
        except SettingError as error:
            raise RecordingError(str(error)) from None
        ros_distro = os.environ.get("ROS_DISTRO", "jazzy")
        self._writer = BagWriter(path, self._offered(), ros_distro=ros_distro)
        self._kept.open(time.time_ns())
        self.failure = ""
        text = f"recording to {path}"
        self.get_logger().info(text)
        return text

    def _offered(self) -> list[RecordedTopic]:
        """Return the topics as their publishers offer them, by the table where there are none."""
        topics = []
        for topic in self._topics:
            found = self.get_publishers_info_by_topic(topic.name)
            profiles = [info.qos_profile for info in found]
            offered = offered_qos(profiles) if profiles else topic.qos
            topics.append(replace(topic, qos=offered))
        return topics

    def _close(self) -> str:
        if self._writer is None:
            if self.failure:
                raise RecordingError(self.failure)
            return "was not recording"
        try:
            self._write_what_is_on_its_way()
            writer, self._writer = self._writer, None
            writer.close()
        except RecordingError as error:
            self._fail(error)
            raise
        count = writer.message_count
        text = f"{count} message{'s' * (count != 1)} in {writer.path}"
        self.get_logger().info(text)
        for complaint in writer.sequences.complaints():
            self.get_logger().warning(f"{writer.path}: {complaint}")
            text += f"; {complaint}"
        return text

    def _report(self) -> None:
        status = DiagnosticStatus(message="not recording")
        writer = self._writer
        if writer is not None:
            complaints = writer.sequences.complaints()
            status.message = "; ".join([f"recording to {writer.path}", *complaints])
            status.values = [KeyValue(key="messages", value=str(writer.message_count))]
            if complaints:
                status.level = DiagnosticStatus.WARN
        if self.failure:
            status.level = DiagnosticStatus.ERROR
            status.message = self.failure
        self._reporter.publish(status)

    def _on_record(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        answer: Future[str] = Future()
        self._requests.put((self._open if request.data else self._close, answer))
        try:
            response.message = answer.result()
            response.success = True
        except RecordingError as error:
            response.message = str(error)
        return response


def _recorded_topics(names: list[str], resolved: list[str]) -> list[RecordedTopic]:
    share = Path(get_package_share_directory("flexarm_msgs"))
    typestore = load_typestore({"flexarm_msgs": share})
    return [
        RecordedTopic(
            topic,
            describe(typestore, TOPICS[name][1], share_of),
            TopicQos(durability="transient_local" if name in _LATCHED else "volatile"),
        )
        for name, topic in zip(names, resolved, strict=True)
    ]


def offered_qos(profiles: Sequence[QoSProfile]) -> TopicQos:
    """Return what several publishers of a topic offer: a viewer of the replay misses nothing."""
    latched = any(each.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in profiles)
    reliable = any(each.reliability == ReliabilityPolicy.RELIABLE for each in profiles)
    return TopicQos(
        reliability="reliable" if reliable else "best_effort",
        durability="transient_local" if latched else "volatile",
    )


def _is_kept(name: str) -> bool:
    return TOPICS[name][2] is qos.STATUS


def _known_topics(values: Mapping[str, Any]) -> list[str]:
    unknown = [name for name in values["topics"] if name not in TOPICS]
    if unknown:
        raise SettingError(f"parameter topics: no {unknown[0]}; choose from {', '.join(TOPICS)}")
    return list(values["topics"])


def main() -> int:
    """Run the node; an unfinished recording is an error of the process."""
    return run(RecorderNode)

"""Recorder node: writes flexarm's topics into a bag that survives a crash.

The node records from its start when the parameter `bag` names a folder. The service `~/record`
starts and stops it. Every message gets the time at which it was published. In snapshot mode the
last messages stay in memory, and the service `~/snapshot` writes them. A disk that refuses the data
ends the recording with an error, in the log and on `/diagnostics`, and has no other effect.
"""

from __future__ import annotations

import os
import queue
import struct
import threading
import time
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from flexarm_bags.records.storage_file import CHUNK_BYTES
from flexarm_bags.sequence import COMMANDS, SEQUENCED, stamp_of
from flexarm_bags.writer import BagWriter, RecordingError
from flexarm_core.errors import SettingError
from flexarm_core.own_files import user_path
from flexarm_core.tables import read_table
from flexarm_daq.nodes.recorded_topics import (
    IN_FORCE,
    TOPICS,
    is_best_effort,
    offered_qos,
    recorded_topics,
)
from flexarm_daq.nodes.recording import LastMessages, Recording
from flexarm_node.parameters import Parameters
from flexarm_node.process import run
from flexarm_node.qos import EVERY, RECORDED, SEEN, STATUS
from flexarm_node.reports import Level, Report, Reporter, entries
from flexarm_node.stamps import NodeTime
from flexarm_node.topics.waiting import RawMessage, RawTopicsWaiter, node_names

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rclpy.topic_endpoint_info import TopicEndpointInfo

    from flexarm_bags.metadata import RecordedTopic


PARAMETERS = read_table("flexarm_daq.nodes", "recorder", {"topics": tuple(TOPICS)})
_ResponseT = TypeVar("_ResponseT", SetBool.Response, Trigger.Response)
_WAIT_S = 0.1
_REPORT_S = 1.0
_SILENT_REPORTS = 5
"""So many reports without a message say that nobody publishes."""


class RecorderNode(Node):
    """Node that connects topics to a `Recording`; one thread owns it, and services ask that."""

    def __init__(self) -> None:
        super().__init__("recorder", namespace="/flexarm")
        self._settings = Parameters(self, PARAMETERS, accept=_refuse_small_files)
        wanted = self._settings.values()["topics"]
        names = [name for name in TOPICS if name in wanted]
        resolved = [self.resolve_topic_name(name) for name in names]
        self._topics = recorded_topics(names, resolved)
        self._waiter = RawTopicsWaiter(self, [(TOPICS[name][0], name, RECORDED) for name in names])
        self._samples = {
            number
            for number, topic in enumerate(self._topics)
            if topic.definition.type_name in SEQUENCED - COMMANDS
        }
        self._sampled_ns = 0
        self._in_force = []
        for number, (topic, name) in enumerate(zip(resolved, names, strict=True)):
            if name in IN_FORCE:
                # What was said before this node came.
                self._waiter.also(number, STATUS)
                self._in_force.append(topic)
        self._recording = Recording(
            resolved, self._in_force, quiet_s=self._settings.values()["quiet_s"]
        )
        self._reported: set[str] = set()
        if self._settings.values()["snapshot_mode"]:
            self.create_service(Trigger, "~/snapshot", self._on_snapshot)
        self._requests: queue.SimpleQueue[tuple[Callable[[], str], Future[str]]] = (
            queue.SimpleQueue()
        )
        self._stopping = threading.Event()
        self._silent_reports = 0
        self._time = NodeTime(self)
        self._reporter = Reporter(self)
        self.create_timer(_REPORT_S, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.create_service(SetBool, "~/record", self._on_record)
        if self._settings.values()["bag"]:
            try:
                self._open()
            except RecordingError as error:
                raise SettingError(f"parameter bag: {error}") from None
        self._thread = threading.Thread(target=self._record, daemon=True, name="recording")
        self._thread.start()

    @property
    def failure(self) -> str:
        """Why the last recording stopped by itself; empty when it did not."""
        return self._recording.failure

    def stop(self) -> None:
        """Write the messages that have come so far and close the bag."""
        self._stopping.set()
        self._thread.join()

    def _record(self) -> None:
        while not self._stopping.is_set():
            messages = self._waiter.wait(_WAIT_S)
            try:
                self._recording.take(messages, time.monotonic_ns())
            except RecordingError:
                self.get_logger().error(self.failure)
            self._follow(messages)
            while not self._requests.empty():
                action, answer = self._requests.get()
                try:
                    answer.set_result(action())
                except RecordingError as error:
                    answer.set_exception(error)
        with suppress(RecordingError):
            self._close()

    def _follow(self, messages: Sequence[RawMessage]) -> None:
        """Note the stamp of the newest sample: the time of what this node reports."""
        for message in reversed(messages):
            if message.topic in self._samples:
                with suppress(struct.error):
                    self._sampled_ns = stamp_of(message.raw)
                return

    def _write_what_is_on_its_way(self) -> None:
        """Write every message that was sent before now and comes in time."""
        self._recording.end(time.monotonic_ns())
        # A busy machine may have left so many unread; the clock would end this before they are.
        waiting = EVERY.depth * len(self._topics)
        while self._recording.ending and waiting > 0:
            messages = self._waiter.wait(_WAIT_S)
            self._recording.finish(messages, time.monotonic_ns())
            waiting -= len(messages)

    def _open(self) -> str:
        if self._recording.writer is not None:
            raise RecordingError(f"already recording to {self._recording.writer.path}")
        bag = self._settings.values()["bag"]
        if not bag:
            raise RecordingError("set the parameter bag to the folder to create")
        try:
            path = user_path(bag).absolute()
        except SettingError as error:
            raise RecordingError(str(error)) from None
        ros_distro = os.environ.get("ROS_DISTRO", "jazzy")
        settings = self._settings.values()
        writer = BagWriter(
            path,
            self._offered(),
            ros_distro=ros_distro,
            max_file_bytes=settings["max_bagfile_size"],
            max_file_s=settings["max_bagfile_duration"],
        )
        last = None
        if settings["snapshot_mode"]:
            last = LastMessages(settings["snapshot_duration"], self._in_force)
        self._recording.open(writer, time.time_ns(), last)
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
        writer = self._recording.writer
        text = self._ended(self._recording.close)
        if writer is not None:
            self.get_logger().info(text)
            for complaint in writer.sequences.complaints():
                self.get_logger().warning(f"{writer.path}: {complaint}")
        return text

    def _write_snapshot(self) -> str:
        text = self._ended(lambda: self._recording.snapshot(time.time_ns()))
        self.get_logger().info(text)
        return text

    def _ended(self, end: Callable[[], str]) -> str:
        """End a bag or a snapshot, with what is on its way to it; a failure is logged."""
        was_recording = self._recording.writer is not None
        try:
            self._write_what_is_on_its_way()
            return end()
        except RecordingError:
            if was_recording and self.failure:
                self.get_logger().error(self.failure)
            raise

    def _report(self) -> None:
        level, message, values = Level.OK, "not recording", {}
        writer, last = self._recording.writer, self._recording.last
        self._look_at_publishers()
        if writer is not None:
            complaints = [*writer.sequences.complaints(), *self._silence(writer)]
            level = Level.WARN if complaints else Level.OK
            message = "; ".join([f"recording to {writer.path}", *complaints])
            values = {"messages": writer.message_count}
            if last is not None:
                values["messages kept for a snapshot"] = len(last)
        if self.failure:
            level, message = Level.ERROR, self.failure
        now_ns, sampled_ns = self._time.now_ns(), self._sampled_ns
        self._sampled_ns = 0
        self._reporter.publish(Report(level, message, entries(values)), sampled_ns or now_ns)

    def _look_at_publishers(self) -> None:
        """Subscribe as publishers offer, where they offer less, and tell what a bag lacks."""
        for number, topic in enumerate(self._topics):
            for info in self.get_publishers_info_by_topic(topic.name):
                said = _mismatch(info, topic)
                if not said or said in self._reported:
                    continue
                self._reported.add(said)
                self.get_logger().warning(f"{topic.name}: {said}")
                if is_best_effort(info.qos_profile) and topic.name not in self._reported:
                    self._reported.add(topic.name)
                    self._waiter.also(number, SEEN)

    def _silence(self, writer: BagWriter) -> list[str]:
        """Complain when nobody has published for long, in the log too."""
        if writer.message_count > 0 or self._recording.last is not None:
            self._silent_reports = 0
            return []
        self._silent_reports += 1
        text = f"no message yet: is the loop of {self.get_namespace()} up?"
        if self._silent_reports == _SILENT_REPORTS:
            self.get_logger().warning(text)
        return [text] if self._silent_reports >= _SILENT_REPORTS else []

    def _on_record(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        return self._answered(self._open if request.data else self._close, response)

    def _on_snapshot(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._answered(self._write_snapshot, response)

    def _answered(self, action: Callable[[], str], response: _ResponseT) -> _ResponseT:
        """Have the recording thread act, and answer what it says."""
        answer: Future[str] = Future()
        self._requests.put((action, answer))
        try:
            response.message = answer.result()
            response.success = True
        except RecordingError as error:
            response.message = str(error)
        return response


def _mismatch(info: TopicEndpointInfo, topic: RecordedTopic) -> str:
    """Return what a bag lacks of a publisher; empty where it lacks nothing."""
    (name,) = node_names([info])
    if info.topic_type != topic.definition.type_name:
        return f"{name} publishes {info.topic_type}, and {topic.definition.type_name} is recorded"
    if is_best_effort(info.qos_profile):
        return f"{name} publishes as best effort: what is lost on the way is not sent again"
    return ""


def _refuse_small_files(values: Mapping[str, Any]) -> None:
    for name, least in (("max_bagfile_size", CHUNK_BYTES), ("max_bagfile_duration", 1)):
        if 0 < values[name] < least:
            raise SettingError(
                f"parameter {name} = {values[name]:g}: must be 0, or {least} or more"
            )


def main() -> int:
    """Run the node; an unfinished recording is an error of the process."""
    return run(RecorderNode, keeps_up=True)

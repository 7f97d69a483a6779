"""Bag content check: types, definitions, values, numbers and clocks of the messages."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from flexarm_bags.reader import (
    ARM_STATE,
    CHANNEL_INFO,
    COMMANDER_INFO,
    IO_COMMAND,
    IO_SAMPLE,
    LAW_IN_FORCE,
    MOTOR_COMMAND,
    REFERENCE,
)
from flexarm_bags.records.columns import CdrError, Member, decode, members
from flexarm_bags.timeline import (
    clock_problems,
    number_gaps,
    number_problems,
    restarts,
    taking_turns,
)
from flexarm_core.errors import one_line
from flexarm_core.labels import counted

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from rosbags.highlevel import AnyReader

    from flexarm_bags.mcap_check import TopicMessages
    from flexarm_bags.records.columns import Column

    Integers = NDArray[np.int64]


EXPECTED = {
    "state": ARM_STATE,
    "command": MOTOR_COMMAND,
    "reference": REFERENCE,
    "joint_states": "sensor_msgs/msg/JointState",
    "io": IO_SAMPLE,
    "io_command": IO_COMMAND,
    "io_channels": CHANNEL_INFO,
    "commander": COMMANDER_INFO,
    "law": LAW_IN_FORCE,
}
"""Types of the project's topics, by the last part of their names."""

_SAMPLED = frozenset({ARM_STATE, IO_SAMPLE})
_NUMBERED = _SAMPLED | {MOTOR_COMMAND, IO_COMMAND}
_NEEDED = ("header.stamp.sec", "header.stamp.nanosec", "sequence")


@dataclass
class TopicContent:
    """Columns of a topic's messages that the check keeps."""

    type_name: str
    layout: tuple[Member, ...] | None
    is_numbered: bool
    count: int = 0
    numbers: list[Integers] = field(default_factory=list)
    stamps_ns: list[Integers] = field(default_factory=list)
    log_times_ns: list[Integers] = field(default_factory=list)
    complained: set[str] = field(default_factory=set)
    unmeasured: int = 0


class ContentCheck:
    """Content check of a bag that goes through its messages topic by topic, in pieces.

    Parameters
    ----------
    problems : list of str
        Receives what is wrong, one line each.
    notes : list of str
        Receives what is worth knowing of a good bag, one line each.

    Attributes
    ----------
    topics : dict of str to TopicContent
        Content of each topic.
    first_ns, last_ns : int
        Earliest and latest log time.
    skipped : list of str
        Those of the problems that are periods without a sample.
    """

    def __init__(self, problems: list[str], notes: list[str]) -> None:
        self._problems = problems
        self._notes = notes
        self._reader: AnyReader | None = None
        self._loose = 0
        self._commanders: dict[str, set[str]] = {}
        self.topics: dict[str, TopicContent] = {}
        self.first_ns, self.last_ns = 2**63 - 1, 0
        self.skipped: list[str] = []

    @property
    def total(self) -> int:
        """Messages seen."""
        return self._loose + sum(topic.count for topic in self.topics.values())

    @property
    def samples(self) -> int:
        """Messages seen that are samples, or may be samples."""
        sampled = (each.count for each in self.topics.values() if each.type_name in _SAMPLED)
        return self._loose + sum(sampled)

    def connect(self, reader: AnyReader) -> None:
        """Take over topics, types and definitions of an open bag."""
        self._reader = reader
        for connection in reader.connections:
            name, type_name = connection.topic, connection.msgtype
            known = self.topics.get(name)
            if known is not None and known.type_name != type_name:
                self._problems.append(f"{name}: has two types, {known.type_name} and {type_name}")
            try:
                layout = members(type_name, reader.typestore.fielddefs)
            except CdrError:
                layout = None
            if type_name == COMMANDER_INFO or (layout and any(each.is_list for each in layout)):
                layout = None
            there = {member.name for member in layout or ()}
            lacking = [member for member in _NEEDED if member not in there]
            is_numbered = type_name in _NUMBERED
            if is_numbered and lacking:
                self._problems.append(f"{name}: {type_name} is without {', '.join(lacking)}")
            self.topics[name] = TopicContent(type_name, layout, is_numbered and not lacking)
        ours = {
            _place(name)
            for name, topic in self.topics.items()
            if topic.type_name.startswith("flexarm_msgs/")
        } | {"/flexarm"}
        for name, topic in self.topics.items():
            place, _, last = name.rpartition("/")
            expected = EXPECTED.get(last, topic.type_name)
            if place in ours and topic.type_name != expected:
                self._problems.append(f"{name}: has type {topic.type_name}, not {expected}")

    def add(self, found: TopicMessages) -> None:
        """Check some messages of a topic."""
        messages = found.messages
        count = len(messages.log_times_ns)
        self.first_ns = min(self.first_ns, int(messages.log_times_ns.min()))
        self.last_ns = max(self.last_ns, int(messages.log_times_ns.max()))
        topic = self.topics.get(found.topic)
        if topic is None or self._reader is None:
            self._loose += count
            return
        first, topic.count = topic.count, topic.count + count
        try:
            if topic.layout is None:
                for raw in messages.raws():
                    message = self._reader.deserialize(raw, topic.type_name)
                    if topic.type_name == COMMANDER_INFO:
                        nodes = self._commanders.setdefault(_place(found.topic), set())
                        nodes.add(message.node)  # type: ignore[attr-defined]
                return
            columns = decode(messages.groups, topic.layout)
        except Exception as error:  # noqa: BLE001 - rosbags raises anything on foreign bytes
            self._complain(
                found.topic, "definition", f"do not fit the definition: {one_line(error)}"
            )
            return
        for name, column in columns.items():
            if column.dtype.kind == "f" and not np.isfinite(column).all():
                self._not_finite(found.topic, name, column, first)
        if topic.is_numbered:
            seconds = columns["header.stamp.sec"].astype(np.int64)
            nanoseconds = columns["header.stamp.nanosec"].astype(np.int64)
            if np.any(nanoseconds >= 10**9) or np.any(seconds < 0):
                self._complain(found.topic, "stamp", "a stamp is not a time since the epoch")
            topic.numbers.append(columns["sequence"].astype(np.int64))
            topic.stamps_ns.append(seconds * 10**9 + nanoseconds)
            topic.log_times_ns.append(messages.log_times_ns)

    def _not_finite(self, topic: str, name: str, column: Column, first: int) -> None:
        bad = ~np.isfinite(column)
        content = self.topics[topic]
        if content.type_name == IO_SAMPLE and name == "outputs":
            content.unmeasured += int(np.isnan(column).sum())
            bad = np.isinf(column)
        if bad.any():
            row = first + int(np.argwhere(bad)[0][0])
            self._complain(topic, name, f"{name} is not finite in message {row}")

    def _complain(self, name: str, kind: str, text: str) -> None:
        """Report each kind of problem once, where it first occurs."""
        if kind not in self.topics[name].complained:
            self.topics[name].complained.add(kind)
            self._problems.append(f"{name}: {text}")

    def judge(self) -> None:
        """Check numbers and times, when all messages were added."""
        for name, topic in self.topics.items():
            if topic.unmeasured:
                values = counted(topic.unmeasured, "output")
                self._notes.append(f"{name}: {values} without a value (NaN): not measured")
            if not topic.numbers:
                continue
            numbers = np.concatenate(topic.numbers)
            stamps_ns = np.concatenate(topic.stamps_ns)
            log_times_ns = np.concatenate(topic.log_times_ns)
            turns = taking_turns(numbers)
            if len(turns):
                self._problems.append(f"{name}: {self._two_sources(name, numbers, turns)}")
                continue
            begins = restarts(numbers, log_times_ns)
            if len(begins):
                self._notes.append(f"{name}: {_restarted(topic, numbers[begins - 1])}")
            runs = (np.split(column, begins) for column in (numbers, stamps_ns, log_times_ns))
            for run, columns in enumerate(zip(*runs, strict=True), start=1):
                sampled = topic.type_name in _SAMPLED
                problems = number_problems(columns[0], topic.type_name)
                where = f"{name}, run {run}" if len(begins) else name
                if sampled:
                    problems += clock_problems(*columns)
                    gaps = number_gaps(columns[0], topic.type_name)
                    self.skipped += [f"{where}: {gaps}"] if gaps else []
                self._problems += [f"{where}: {problem}" for problem in problems]

    def _two_sources(self, name: str, numbers: Integers, turns: Integers) -> str:
        """Return in words that two nodes sent at the same time, with those that are known."""
        topic = self.topics[name]
        nodes = sorted(self._commanders.get(_place(name), ()))
        names_nodes = topic.type_name == MOTOR_COMMAND and len(nodes) > 1
        named = f" ({', '.join(nodes)})" if names_nodes else ""
        return (
            f"two nodes sent at the same time{named}: their numbers take turns at "
            f"{counted(len(turns), 'place')}, the first after number {numbers[turns[0] - 1]}; "
            "end one of them and record again"
        )


def _place(topic: str) -> str:
    """Return the namespace of a topic."""
    return topic.rpartition("/")[0]


def _restarted(topic: TopicContent, last: Integers) -> str:
    """Return which numbers were the last ones before a new start."""
    work, each = ("sampling", "sample") if topic.type_name in _SAMPLED else ("control", "command")
    times = f" {len(last)} times, the first" if len(last) > 1 else ""
    return f"{work} was started again{times} after {each} {last[0]}"

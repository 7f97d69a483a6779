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
from flexarm_bags.sequence import missing_text
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
_NS = 1_000_000_000
# The earliest of so many samples in a row is on time.
_SOON = 8
# A step of the lateness by this part of a period is one that may stay.
_STEP = 0.25
# A sample may be late by almost a period: only what is above counts as whole ones.
_EARLY = 0.3
# Steps back from which on, and the share of them with which, two sources take turns; one answers
# a sample so many messages after its last answer at most.
_TURNS = 5
_MOSTLY = 0.8
_NEAR = 3
# A step of one clock against the other, from one sample to the next, that no delay explains.
_CLOCK_STEP_NS = _NS
# Steps of stamps that are whole periods, each rounded to whole nanoseconds: no clock does that.
_ROUNDING_NS = 2
# In virtual time the stamps run much faster than the clock that the messages are sent by.
_REAL_TIME = 0.2


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


def restarts(sequences: Integers, log_times_ns: Integers) -> Integers:
    """Find where the numbering began again at 1 while time went on: a source started again.

    Parameters
    ----------
    sequences, log_times_ns : ndarray of int, (messages,)
        Sequence numbers and instants of sending, in the order of sending.

    Returns
    -------
    ndarray of int, (restarts,)
        Index of the first message of each new run.
    """
    begins = (sequences[1:] == 1) & (sequences[:-1] > 1) & (np.diff(log_times_ns) > 0)
    return np.flatnonzero(begins) + 1


def taking_turns(sequences: Integers) -> Integers:
    """Find where the numbers of two sources on one topic take turns.

    Parameters
    ----------
    sequences : ndarray of int, (messages,)
        Numbers in the order of sending.

    Returns
    -------
    ndarray of int, (turns,)
        Index of each message whose number is not above the one before it, but follows one of those
        that were sent shortly before; nothing where a few places or other faults explain it.
    """
    backward = np.flatnonzero(np.diff(sequences) < 1) + 1
    if len(backward) < _TURNS:
        return np.empty(0, np.int64)
    earlier = backward[:, np.newaxis] - np.arange(2, 2 + _NEAR)
    follows = sequences[backward, np.newaxis] - 1 == sequences[np.maximum(earlier, 0)]
    turns = backward[(follows & (earlier >= 0)).any(axis=1)]
    return turns if len(turns) >= _MOSTLY * len(backward) else np.empty(0, np.int64)


def number_gaps(sequences: Integers, type_name: str) -> str:
    """Return in words how many numbers are left out, and where first; empty where none is.

    Parameters
    ----------
    sequences : ndarray of int, (messages,)
        Numbers in the order of sending.
    type_name : str
        Type of the messages: it gives the meaning of a number that is left out.
    """
    steps = np.diff(sequences)
    gaps = np.flatnonzero(steps > 1)
    if not len(gaps):
        return ""
    text = missing_text(int(np.sum(steps[gaps] - 1)), type_name, len(gaps))
    return f"{text}, the first after number {sequences[gaps[0]]}"


def number_problems(sequences: Integers, type_name: str) -> list[str]:
    """Return gaps of sequence numbers, and places where they do not go up, one line each.

    Parameters
    ----------
    sequences, type_name
        As for `number_gaps`.
    """
    gaps, backward = number_gaps(sequences, type_name), np.flatnonzero(np.diff(sequences) < 1)
    problems = [gaps] if gaps else []
    if len(backward):
        at = backward[0]
        problems.append(
            f"the numbering does not go up at {counted(len(backward), 'place')}, the first after"
            f" number {sequences[at]}, where {sequences[at + 1]} follows"
        )
    return problems


def clock_problems(sequences: Integers, stamps_ns: Integers, log_times_ns: Integers) -> list[str]:
    """Return what is wrong with the instants of sampling and of sending, one line each.

    It finds stamps or times that do not advance, periods without a sample although the numbers
    follow each other, and a clock that was set while recording.

    Parameters
    ----------
    sequences, stamps_ns, log_times_ns : ndarray of int, (messages,)
        Sequence numbers, instants of sampling, and instants of sending.
    """
    following = np.diff(sequences) == 1
    steps_ns, log_steps_ns = np.diff(stamps_ns), np.diff(log_times_ns)
    problems = []
    for name, steps in (("the stamps do", steps_ns), ("the clock does", log_steps_ns)):
        # Two messages may be sent at one instant, but not sampled.
        standing = np.flatnonzero(following & (steps < (name == "the stamps do")))
        if len(standing):
            problems.append(
                f"{name} not advance at {counted(len(standing), 'place')}, the first after"
                f" number {sequences[standing[0]]}"
            )
    if not np.any(following & (steps_ns > 0)):
        return problems
    period_ns = float(np.median(steps_ns[following & (steps_ns > 0)]))
    problems += _skipped(sequences, stamps_ns, period_ns)
    log_period_ns = float(np.median(log_steps_ns[following]))
    jumps_ns = np.where(following, log_steps_ns - steps_ns, 0)
    if np.ptp(steps_ns[following]) <= _ROUNDING_NS:
        # In virtual time the arm's time stands still when the machine stalls or nobody answers.
        jumps_ns = np.minimum(jumps_ns, 0)
    at = int(np.argmax(np.abs(jumps_ns)))
    is_real_time = abs(log_period_ns - period_ns) <= _REAL_TIME * period_ns
    if is_real_time and abs(jumps_ns[at]) > _CLOCK_STEP_NS:
        problems.append(
            f"the clock was set by {jumps_ns[at] / _NS:+.3f} s after number {sequences[at]}"
        )
    return problems


def _skipped(sequences: Integers, stamps_ns: Integers, period_ns: float) -> list[str]:
    """Find periods without a sample that the numbers do not show."""
    found: list[tuple[int, int, int]] = []
    for run in np.split(np.arange(len(sequences)), np.flatnonzero(np.diff(sequences) < 1) + 1):
        stamps = stamps_ns[run]
        advances = np.diff(np.maximum.accumulate(stamps), prepend=stamps[0] - 1) > 0
        found += _left_out(sequences[run][advances], stamps[advances], period_ns)
    if not found:
        return []
    missing, places, first = zip(*found, strict=True)
    problem = (
        f"{counted(sum(missing), 'period')} of {period_ns / 1e6:.3f} ms without a sample at"
        f" {counted(sum(places), 'place')}, the first after number {first[0]}"
    )
    return [problem]


def _left_out(
    sequences: Integers, stamps_ns: Integers, period_ns: float
) -> list[tuple[int, int, int]]:
    """Return periods left out, their number of places, and the number before the first.

    The lateness of a sample refers to the instant of its number. It lasts when periods were left
    out before the sample. The lasting part is the lateness of the earliest of the next samples.
    """
    late = (stamps_ns - stamps_ns[0]) / period_ns - (sequences - sequences[0])
    rises = np.diff(_least_of_the_next(late))
    steps = np.flatnonzero(np.abs(rises) > _STEP)
    # Steps that stand together are judged together: down and up again is only jitter.
    apart = np.flatnonzero(np.diff(steps) > 2 * _SOON) + 1
    found = []
    for group in np.split(steps, apart) if len(steps) else ():
        missing = int(np.floor(rises[group[0] : group[-1] + 1].sum() + _EARLY))
        if missing > 0:
            long = group[rises[group] > 1.0 - _EARLY]
            found.append((missing, max(len(long), 1), int(sequences[group[0]])))
    return found


def _least_of_the_next(late: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the least of each value and those that follow it soon."""
    padded = np.concatenate((late, np.full(_SOON - 1, np.inf)))
    least: NDArray[np.float64] = np.lib.stride_tricks.sliding_window_view(padded, _SOON).min(axis=1)
    return least

"""Recording of topics: serialised messages in, one bag at a time out."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, NamedTuple, Protocol

from flexarm_bags.writer import RecordingError
from flexarm_core.labels import counted

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    from flexarm_bags.writer import BagWriter

_NS = 1_000_000_000
# A recorder that is behind has no quick message meanwhile: those of the seconds before tell.
_RECENT_S = 30
# What seems longer on the way than this comes from a clock that was set.
_LONGEST_WAY_NS = 5 * _NS


class Message(Protocol):
    """One serialised message, with its topic as an index and the instant of its publication."""

    @property
    def topic(self) -> int:
        """Index into the recorded topics."""

    @property
    def raw(self) -> bytes:
        """Serialised message (CDR)."""

    @property
    def source_ns(self) -> int:
        """Instant of publication, nanoseconds since the epoch."""


class KeptMessages:
    """Store of messages that were sent before a bag and belong into it.

    The last message of a kept topic goes into a bag before the first message of any other topic,
    unless a newer one has come by then. A message that is older than the bag gets the time of its
    beginning.

    Parameters
    ----------
    topics : iterable of str
        Kept topics.
    """

    def __init__(self, topics: Iterable[str]) -> None:
        self._topics = frozenset(topics)
        self._last: dict[str, bytes] = {}
        self._due: dict[str, bytes] = {}
        self._begun_ns = 0

    def open(self, now_ns: int) -> None:
        """Begin a bag at an instant, nanoseconds since the epoch."""
        self._begun_ns = now_ns
        self._due = dict(self._last)

    def due(self, topic: str, raw: bytes, time_ns: int) -> Iterator[tuple[str, bytes, int]]:
        """Take the next message with its time of sending, and yield the messages to be written."""
        if topic in self._topics:
            self._last[topic] = raw
            self._due.pop(topic, None)
            yield topic, raw, max(time_ns, self._begun_ns)
            return
        for kept, kept_raw in self._due.items():
            yield kept, kept_raw, self._begun_ns
        self._due.clear()
        yield topic, raw, time_ns


class _Quickest(NamedTuple):
    """Difference of the quickest message of one second of the steady clock."""

    second: int
    difference_ns: int


class SendTimes:
    """Difference between a sender's clock and the steady clock here, by its messages.

    A message comes later than it was sent, never earlier: the largest difference is that of the
    quickest message.
    """

    def __init__(self) -> None:
        self._quickest: deque[_Quickest] = deque()
        self._difference_ns = 0

    def add(self, sent_ns: int, received_ns: int) -> None:
        """Take the instants of a message: of sending there, of receiving on the steady clock."""
        second, difference_ns = received_ns // _NS, sent_ns - received_ns
        if difference_ns < self._difference_ns - _LONGEST_WAY_NS:
            self._quickest.clear()
        if not self._quickest or self._quickest[-1].second != second:
            self._quickest.append(_Quickest(second, difference_ns))
        elif difference_ns > self._quickest[-1].difference_ns:
            self._quickest[-1] = _Quickest(second, difference_ns)
        else:
            return
        while self._quickest[0].second < second - _RECENT_S:
            self._quickest.popleft()
        self._difference_ns = max(each.difference_ns for each in self._quickest)

    def was_sent_before(self, sent_ns: int, now_ns: int, received_ns: int) -> bool:
        """Return whether a message was sent before an instant of the steady clock.

        The first message of a sender counts as sent before, and so does one from the future: its
        clock was set forward meanwhile, and what cannot be told is kept.
        """
        if not self._quickest:
            return True
        if sent_ns - received_ns > self._difference_ns + _LONGEST_WAY_NS:
            return True
        return sent_ns <= now_ns + self._difference_ns


class Recording:
    """Recorder of messages, with or without a bag at the moment.

    It reads no clock and waits for nothing: its caller states the time and brings the messages.

    Parameters
    ----------
    topics : sequence of str
        Recorded topics.
    kept : iterable of str
        Those of them whose last message belongs into every bag; see `KeptMessages`.
    quiet_s : float
        Longest time between the arrivals of two sent messages, s.

    Attributes
    ----------
    writer : BagWriter or None
        Writer of the present bag.
    last : LastMessages or None
        Messages that wait for a snapshot; None when all are written as they come.
    failure : str
        Why the last recording stopped by itself; empty when it did not.
    ending : bool
        True from `end` until all that was sent before it is written.
    """

    def __init__(self, topics: Sequence[str], kept: Iterable[str], *, quiet_s: float) -> None:
        self._topics = tuple(topics)
        self._kept = KeptMessages(kept)
        self._sent = [SendTimes() for _ in topics]
        self._heard_ns = [-math.inf] * len(topics)
        self._awaited: dict[int, float] = {}
        self._later: list[Message] = []
        self._ended_ns = 0
        self._quiet_ns = round(quiet_s * 1e9)
        self.writer: BagWriter | None = None
        self.last: LastMessages | None = None
        self.failure = ""
        self.ending = False

    def open(self, writer: BagWriter, now_ns: int, last: LastMessages | None = None) -> None:
        """Begin a bag at an instant, nanoseconds since the epoch, of all messages or snapshots."""
        self.writer = writer
        self.last = last
        self.failure = ""
        self._kept.open(now_ns)

    def take(self, messages: Sequence[Message], received_ns: int) -> None:
        """Write messages, received at an instant of the steady clock, and flush when that is due.

        The topics may fall silent: this is to be called now and then without messages too.

        Raises
        ------
        RecordingError
            When the disk refuses the data; the recording is over then.
        """
        for message in messages:
            self._sent[message.topic].add(message.source_ns, received_ns)
            self._heard_ns[message.topic] = received_ns
        self._write_and_flush(messages)

    def end(self, now_ns: int) -> None:
        """Begin to end the bag, or to take a snapshot, at an instant of the steady clock."""
        self._ended_ns = now_ns
        topics = range(len(self._topics))
        recent = [topic for topic in topics if now_ns - self._heard_ns[topic] < self._quiet_ns]
        self._awaited = dict.fromkeys(recent or topics, now_ns)
        self._later = []
        self.ending = self.writer is not None

    def finish(self, messages: Sequence[Message], received_ns: int) -> None:
        """Write those that were sent before the end, of messages that were on their way to it.

        Each topic has a way of its own. `ending` turns false when every topic that was heard of
        before the end has brought a later message, or nothing for `quiet_s`. What waits in memory
        meanwhile is flushed when that is due, as in `take`.

        Raises
        ------
        RecordingError
            When the disk refuses the data; the recording is over then.
        """
        due = []
        for message in messages:
            topic = message.topic
            sent = self._sent[topic]
            if not sent.was_sent_before(message.source_ns, self._ended_ns, received_ns):
                self._awaited.pop(topic, None)
                self._later.append(message)
                continue
            due.append(message)
            if topic in self._awaited:
                self._awaited[topic] = received_ns
        self.ending = any(received_ns - last < self._quiet_ns for last in self._awaited.values())
        self._write_and_flush(due)

    def close(self) -> str:
        """Close the bag, and return in words what is in it; one without a message is removed.

        Raises
        ------
        RecordingError
            When there is no bag because the recording has stopped by itself, or when the disk
            refuses the data.
        """
        self.ending = False
        if self.writer is None:
            if self.failure:
                raise RecordingError(self.failure)
            return "was not recording"
        writer = self.writer
        try:
            if writer.message_count == 0:
                writer.discard()
            else:
                writer.close()
        except RecordingError as error:
            self._fail(error)
            raise
        self.writer = None
        if writer.message_count == 0:
            return f"0 messages: no bag is left in {writer.path}"
        content = f"{counted(writer.message_count, 'message')} in {writer.path}"
        return "; ".join([content, *writer.sequences.complaints()])

    def snapshot(self, now_ns: int) -> str:
        """Write the last messages into a file of the bag, and return in words what is in it.

        The bag goes on with the messages that were sent since `end`. The instant is in nanoseconds
        since the epoch.

        Raises
        ------
        RecordingError
            When no messages are kept, or when the disk refuses the data.
        """
        self.ending = False
        if self.writer is None or self.last is None:
            raise RecordingError("not recording: nothing is kept")
        try:
            messages = self.last.take(now_ns)
            for topic, raw, time_ns in messages:
                self.writer.write(topic, raw, time_ns, time_ns)
            self.writer.end_file()
        except RecordingError as error:
            self._fail(error)
            raise
        self._write(self._later)
        return f"snapshot of {counted(len(messages), 'message')} in {self.writer.path}"

    def _write_and_flush(self, messages: Sequence[Message]) -> None:
        try:
            self._write(messages)
            if self.writer is not None:
                self.writer.flush_if_due()
        except RecordingError as error:
            self._fail(error)
            raise

    def _write(self, messages: Sequence[Message]) -> None:
        for message in messages:
            name = self._topics[message.topic]
            for topic, raw, time_ns in self._kept.due(name, message.raw, message.source_ns):
                if self.writer is None:
                    continue
                if self.last is not None:
                    self.last.add(topic, raw, time_ns)
                else:
                    self.writer.write(topic, raw, time_ns, time_ns)

    def _fail(self, error: RecordingError) -> None:
        self.writer = None
        self.ending = False
        self.failure = f"recording stopped: {error}"


class Timed(NamedTuple):
    """Message of a topic as bytes, with its time of sending, nanoseconds since the epoch."""

    topic: str
    raw: bytes
    time_ns: int


class LastMessages:
    """Messages of the last seconds, counted back from the newest one.

    A latched topic holds what is in force: its last message stays when it gets too old, and has the
    time of the oldest other message then.

    Parameters
    ----------
    duration_s : float
        Time that is kept, s.
    latched : collection of str
        Latched topics.
    """

    def __init__(self, duration_s: float, latched: Collection[str]) -> None:
        self._duration_ns = duration_s * 1e9
        self._latched = frozenset(latched)
        self._messages: deque[Timed] = deque()
        self._in_force: dict[str, bytes] = {}

    def __len__(self) -> int:
        return len(self._in_force) + len(self._messages)

    def add(self, topic: str, raw: bytes, time_ns: int) -> None:
        """Take the next message, and forget those that are too old by now."""
        messages = self._messages
        messages.append(Timed(topic, raw, time_ns))
        while time_ns - messages[0].time_ns > self._duration_ns:
            self._forget(messages.popleft())

    def take(self, now_ns: int) -> list[Timed]:
        """Return what is kept, in the order of arrival, and keep what is in force only.

        Parameters
        ----------
        now_ns : int
            Instant, nanoseconds since the epoch. Messages that were sent after it tell that the
            clock was set back meanwhile: they are kept, and make no other message too old.
        """
        if not self._messages:
            return []
        # Each topic has a way of its own: an old message may have come behind a younger one.
        times_ns = (message.time_ns for message in self._messages)
        newest_ns = max((time_ns for time_ns in times_ns if time_ns <= now_ns), default=now_ns)
        taken: list[Timed] = []
        for message in self._messages:
            if newest_ns - message.time_ns <= self._duration_ns:
                taken.append(message)
            else:
                self._forget(message)
        begin_ns = min(message.time_ns for message in taken)
        first = [Timed(topic, raw, begin_ns) for topic, raw in self._in_force.items()]
        self._messages.clear()
        self._in_force |= {each.topic: each.raw for each in taken if each.topic in self._latched}
        return [*first, *taken]

    def _forget(self, message: Timed) -> None:
        if message.topic in self._latched:
            self._in_force[message.topic] = message.raw

"""Waiting in the calling thread, outside any executor: for messages, and for readers.

An executor costs several hundred microseconds per message and stalls now and then; a loop that
answers every sample waits on the middleware itself, and takes bytes. This is the only module that
touches rclpy's internal `WaitSet` and `take_message`.

A topic that a node publishes and reads is read by the thread of the loop, too. In an executor each
message of the node itself would wake another thread, which takes longer than the answer to a
sample: a reference that changes with every sample would take all of the time of a fast loop.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Protocol, TypeVar

from rclpy.callback_groups import CallbackGroup
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.serialization import deserialize_message

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from rclpy.node import Node
    from rclpy.publisher import Publisher
    from rclpy.qos import QoSProfile
    from rclpy.topic_endpoint_info import TopicEndpointInfo

# A discovery that misses the first announcements hears the next ones after 3 s.
_MATCH_TIMEOUT_S = 7.0
_MATCH_POLL_S = 0.01
# Under settings of the user's own the middleware may ask its readers only every 3 s.
_ACKNOWLEDGED_S = 5.0
_RAW = True
# As many as a reader holds: what one brings late another has brought before.
_KEYS_REMEMBERED = 20_000
Message = TypeVar("Message")

# More than are ever on their way to the node itself.
_REMEMBERED = 100


def has_every_reader(node: Node, publishers: Sequence[Publisher], least: int = 0) -> bool:
    """Return whether a message that is sent now reaches every reader.

    Parameters
    ----------
    node : Node
        Its graph knows the readers.
    publishers : sequence of Publisher
        Publishers of the topics.
    least : int
        Readers that one of the topics must have: the graph may not know of all yet.
    """
    matched = [publisher.get_subscription_count() for publisher in publishers]
    known = [node.count_subscribers(publisher.topic_name) for publisher in publishers]
    return max(matched, default=0) >= least and all(map(int.__ge__, matched, known))


def node_names(endpoints: Iterable[TopicEndpointInfo]) -> list[str]:
    """Return the full names of the nodes of endpoints, in the order of the alphabet."""
    return sorted(f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in endpoints)


def wait_until(condition: Callable[[], bool]) -> bool:
    """Poll until endpoints have found each other; return False after some seconds without."""
    deadline_s = time.monotonic() + _MATCH_TIMEOUT_S
    while not condition():
        if time.monotonic() >= deadline_s:
            return False
        time.sleep(_MATCH_POLL_S)
    return True


def await_acknowledged(*publishers: Publisher) -> None:
    """Wait until every reader has every message, for some seconds in all: a reader may be dead.

    A reader may have paused, or may discover the topic late: then it gets all messages at once.
    """
    deadline_s = time.monotonic() + _ACKNOWLEDGED_S
    for publisher in publishers:
        left_s = max(0.0, deadline_s - time.monotonic())
        publisher.wait_for_all_acked(Duration(nanoseconds=round(left_s * 1e9)))


def message_of(raw: bytes, message_type: type) -> Any | None:  # noqa: ANN401 - the type says it
    """Return a message from its bytes; None for bytes of no message, which rclpy drops too."""
    try:
        return deserialize_message(raw, message_type)
    except (RuntimeError, UnicodeDecodeError):
        return None


def content_of(raw: bytes, layout: Unpacking[ContentT_co]) -> ContentT_co | None:
    """Return the content of a message; None for bytes of no message."""
    found = layout.unpack(raw)
    if found is not None:
        return found
    message = message_of(raw, layout.message_type)
    return None if message is None else layout.numbers(message)


class _OutsideExecutor(CallbackGroup):
    """Entities in this group are never handed to an executor."""

    def can_execute(self, entity: object) -> bool:  # noqa: ARG002 - the base class's signature
        return False

    def beginning_execution(self, entity: object) -> bool:  # noqa: ARG002 - the base class's signature
        return False

    def ending_execution(self, entity: object) -> None:
        """Do nothing: no execution ever begins."""


class RawMessage(NamedTuple):
    """One serialised message."""

    topic: int
    """Index into the topics that are waited on."""
    raw: bytes
    """Serialised message (CDR)."""
    source_ns: int
    """Instant of publication, nanoseconds since the epoch."""


ContentT_co = TypeVar("ContentT_co", covariant=True)


class Unpacking(Protocol[ContentT_co]):
    """Reading of one message type: a `Layout`, or a packing of samples or commands."""

    message_type: type

    def unpack(self, raw: bytes) -> ContentT_co | None:
        """Return the content of a message with the usual layout; None for another one."""

    def numbers(self, message: object) -> ContentT_co | None:
        """Return the content of a message object; None for one that has none."""


class TopicWaiter(Generic[ContentT_co]):
    """A subscription that one thread waits on, for the content of the messages.

    Parameters
    ----------
    node : Node
        Owner of the subscription.
    layout : Unpacking
        Usual layout of the messages; others are read by rclpy, which takes longer.
    topic, qos
        As for `Node.create_subscription`.
    """

    def __init__(
        self, node: Node, layout: Unpacking[ContentT_co], topic: str, qos: QoSProfile
    ) -> None:
        self._layout = layout
        self._waiting = _WaitSet(node, [(layout.message_type, topic, qos)])

    @property
    def topic(self) -> str:
        """Full name of the topic, after remapping."""
        return self._waiting.topic(0)

    def publishers(self) -> int:
        """Return how many publishers of the topic the graph knows."""
        return self._waiting.publishers(0)

    def wait_newest(self, timeout_s: float) -> ContentT_co | None:
        """Return a message, or None when none came in time.

        With the QoS `NEWEST` the reader holds the newest alone. To look for another one behind it
        takes as long as a part of a law.
        """
        taken = self._waiting.take(0)
        if taken is None and timeout_s > 0.0:
            self._waiting.wait(timeout_s)
            taken = self._waiting.take(0)
        return None if taken is None else content_of(taken[0], self._layout)

    def wait_all(self, timeout_s: float) -> list[ContentT_co]:
        """Return all waiting messages, or those that come within the time; possibly none."""
        messages = self._take_all()
        if not messages and timeout_s > 0.0:
            self._waiting.wait(timeout_s)
            messages = self._take_all()
        return messages

    def close(self) -> None:
        """Remove the subscription. No thread may be waiting any more."""
        self._waiting.close()

    def _take_all(self) -> list[ContentT_co]:
        messages = []
        while (taken := self._waiting.take(0)) is not None:
            found = content_of(taken[0], self._layout)
            if found is not None:
                messages.append(found)
        return messages


class RawTopicsWaiter:
    """Subscriptions to several topics that one thread waits on, for their bytes.

    Parameters
    ----------
    node : Node
        Owner of the subscriptions.
    topics : sequence of (type, str, QoSProfile)
        Message type, topic and QoS of each.
    """

    def __init__(self, node: Node, topics: Sequence[tuple[type, str, QoSProfile]]) -> None:
        self._waiting = _WaitSet(node, topics)
        self._sources = list(topics)
        self._topics = list(range(len(topics)))
        self._heard: dict[int, _Heard] = {}

    def also(self, topic: int, qos: QoSProfile) -> None:
        """Hear the publishers of a topic that its first subscription does not match, too.

        A message that several subscriptions bring is returned once. Any thread may call.
        """
        message_type, name, _ = self._sources[topic]
        self._heard.setdefault(topic, _Heard())
        self._waiting.add((message_type, name, qos))
        self._topics.append(topic)

    def wait(self, timeout_s: float) -> list[RawMessage]:
        """Return all waiting messages, or those that come within the time; possibly none."""
        messages = self._take_all()
        if not messages and timeout_s > 0.0:
            self._waiting.wait(timeout_s)
            messages = self._take_all()
        return messages

    def close(self) -> None:
        """Remove the subscriptions. No thread may be waiting any more."""
        self._waiting.close()

    def _take_all(self) -> list[RawMessage]:
        messages = []
        for place, topic in enumerate(tuple(self._topics)):
            heard = self._heard.get(topic)
            while (taken := self._waiting.take(place)) is not None:
                message = RawMessage(topic, taken[0], taken[1]["source_timestamp"])
                if heard is None or heard.is_new(message):
                    messages.append(message)
        return messages


class _Heard:
    """What several subscriptions of a topic have brought lately."""

    def __init__(self) -> None:
        self._keys: dict[tuple[int, bytes], None] = {}

    def is_new(self, message: RawMessage) -> bool:
        """Return whether a message was not brought before."""
        key = message.source_ns, message.raw
        if key in self._keys:
            return False
        self._keys[key] = None
        if len(self._keys) > _KEYS_REMEMBERED:
            del self._keys[next(iter(self._keys))]
        return True


class _WaitSet:
    """Raw subscriptions outside the executor and the wait set that holds them."""

    def __init__(self, node: Node, topics: Sequence[tuple[type, str, QoSProfile]]) -> None:
        self._node = node
        # Held here: rclpy keeps callback groups by weak reference.
        self._group = _OutsideExecutor()
        self._subscriptions: list[Any] = []
        self._types: list[type] = []
        for topic in topics:
            self.add(topic)
        self._size = 0

    def add(self, topic: tuple[type, str, QoSProfile]) -> None:
        message_type, name, qos = topic
        self._types.append(message_type)
        self._subscriptions.append(
            self._node.create_subscription(
                message_type, name, _never_called, qos, callback_group=self._group, raw=True
            )
        )

    def wait(self, timeout_s: float) -> None:
        subscriptions = tuple(self._subscriptions)
        if len(subscriptions) != self._size:
            self._size = len(subscriptions)
            self._wait_set = rclpy_implementation.WaitSet(
                self._size, 0, 0, 0, 0, 0, self._node.context.handle
            )
        self._wait_set.clear_entities()
        for subscription in subscriptions:
            self._wait_set.add_subscription(subscription.handle)
        self._wait_set.wait(int(timeout_s * 1e9))

    def topic(self, topic: int) -> str:
        return str(self._subscriptions[topic].topic_name)

    def publishers(self, topic: int) -> int:
        return int(self._node.count_publishers(self.topic(topic)))

    def take(self, topic: int) -> tuple[bytes, dict[str, int]] | None:
        handle = self._subscriptions[topic].handle
        with handle:
            taken: tuple[bytes, dict[str, int]] | None = handle.take_message(
                self._types[topic], _RAW
            )
        return taken

    def close(self) -> None:
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)


def _never_called(_: Any) -> None:  # noqa: ANN401 - any message type
    raise AssertionError


@dataclass
class _Sending:
    begun_ns: int
    ended_ns: float = math.inf


class SharedTopic(Generic[Message]):
    """Publisher and subscription of one topic.

    The middleware delivers a node's own messages to it as well, a moment later: one that is heard
    after the next was sent would bring the old value back. It does not say who sent a message, but
    when, and own messages were sent while this class was sending.

    Parameters
    ----------
    node : Node
        Node that publishes and reads.
    message_type, topic
        As for `Node.create_publisher`.
    sent, read : QoSProfile
        QoS of the publisher and of the subscription.
    """

    def __init__(
        self,
        node: Node,
        message_type: type[Message],
        topic: str,
        *,
        sent: QoSProfile,
        read: QoSProfile,
    ) -> None:
        self._node = node
        self._message_type = message_type
        self._sent: deque[_Sending] = deque(maxlen=_REMEMBERED)
        self.publisher: Publisher[Message] = node.create_publisher(message_type, topic, sent)
        self._reader = RawTopicsWaiter(node, [(message_type, topic, read)])
        self._turn = threading.Lock()

    def publish(self, message: Message) -> None:
        """Publish a message. Any thread may call."""
        sending = _Sending(time.time_ns())
        # Before it is sent: another thread may hear it at once.
        self._sent.append(sending)
        self.publisher.publish(message)
        sending.ended_ns = time.time_ns()

    def newest(self) -> Message | None:
        """Return the newest message of others that was not returned yet. Any thread may call."""
        with self._turn:
            for heard in reversed(self._reader.wait(0.0)):
                if not self._is_own(heard.source_ns):
                    message: Message | None = message_of(heard.raw, self._message_type)
                    return message
        return None

    def close(self) -> None:
        """Remove publisher and subscription."""
        self._node.destroy_publisher(self.publisher)
        self._reader.close()

    def _is_own(self, sent_ns: int) -> bool:
        # A copy: another thread may be adding to it.
        newest_first = reversed(tuple(self._sent))
        return any(own.begun_ns <= sent_ns <= own.ended_ns for own in newest_first)

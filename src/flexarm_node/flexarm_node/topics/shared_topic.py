"""Topic that a node publishes and reads: it hears what others publish there, and not itself."""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rclpy.node import Node
    from rclpy.publisher import Publisher
    from rclpy.qos import QoSProfile

Message = TypeVar("Message")

# More than are ever on their way to the node itself.
_REMEMBERED = 100


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
    heard : callable
        Called in the executor's thread with every message of others.
    """

    def __init__(
        self,
        node: Node,
        message_type: type[Message],
        topic: str,
        *,
        sent: QoSProfile,
        read: QoSProfile,
        heard: Callable[[Message], None],
    ) -> None:
        self._node = node
        self._heard = heard
        self._sent: deque[_Sending] = deque(maxlen=_REMEMBERED)
        self.publisher: Publisher[Message] = node.create_publisher(message_type, topic, sent)
        self._subscription = node.create_subscription(message_type, topic, self._on_message, read)

    def publish(self, message: Message) -> None:
        """Publish a message. Any thread may call."""
        sending = _Sending(time.time_ns())
        # Before it is sent: another thread may hear it at once.
        self._sent.append(sending)
        self.publisher.publish(message)
        sending.ended_ns = time.time_ns()

    def close(self) -> None:
        """Remove publisher and subscription."""
        self._node.destroy_publisher(self.publisher)
        self._node.destroy_subscription(self._subscription)

    def _on_message(self, message: Message, info: Mapping[str, Any]) -> None:
        sent_ns = info["source_timestamp"]
        # A copy: another thread may be adding to it.
        newest_first = reversed(tuple(self._sent))
        if not any(own.begun_ns <= sent_ns <= own.ended_ns for own in newest_first):
            self._heard(message)

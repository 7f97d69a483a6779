"""Topic that a node publishes and reads: it hears what others publish there, and not itself.

It is read by the thread of the loop. In an executor each message of the node itself would wake
another thread, which takes longer than the answer to a sample: a reference that changes with every
sample would take all of the time of a fast loop.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

from flexarm_node.topics.waiting import RawTopicsWaiter, message_of

if TYPE_CHECKING:
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

"""Samples that a test hears on the topic, without an executor."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from rclpy.serialization import deserialize_message

from flexarm_msgs.msg import ArmState
from flexarm_node import qos
from flexarm_node.topics.waiting import RawTopicsWaiter

if TYPE_CHECKING:
    from rclpy.node import Node


class HeardStates:
    """Samples that were published since the last `forget`.

    They are taken from the middleware when somebody asks for them. An executor takes one at a time,
    on a busy machine slower than they come: a test would look at what was long ago.

    Parameters
    ----------
    node
        Owner of the subscription.
    """

    def __init__(self, node: Node) -> None:
        self._waiter = RawTopicsWaiter(node, [(ArmState, "state", qos.EVERY)])
        self._states: list[ArmState] = []
        self._since_ns = 0

    def forget(self) -> None:
        """Leave out what was published before now."""
        self._since_ns = time.time_ns()
        self._states.clear()

    def all(self) -> list[ArmState]:
        """Return the samples that have come so far."""
        self._states += [
            deserialize_message(message.raw, ArmState)
            for message in self._waiter.wait(0.0)
            if message.source_ns >= self._since_ns
        ]
        return self._states

"""Bodies of the arm for the pages: from the topics of a rig that knows them."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

import numpy as np
from std_msgs.msg import Float32MultiArray, String

from flexarm_node import qos

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from flexarm_live.serving.laboratory import Outlet

_LEAST_S = 0.03
"""Between two messages to the pages: an arm as fast as it goes has many more poses."""
_NUMBERS, _DIGITS = 7, 5
"""Of a pose."""


class ShownBodies:
    """Reader of the bodies, which sends them to the pages.

    Parameters
    ----------
    node : Node
        Node for the readers.
    outlet : callable
        Returns what sends messages to the pages.

    Attributes
    ----------
    solids : list of dict
        What the bodies are made of; empty for an arm without bodies.
    """

    def __init__(self, node: Node, outlet: Callable[[], Outlet]) -> None:
        self.solids: list[dict[str, Any]] = []
        self._outlet = outlet
        self._sent_s = 0.0
        node.create_subscription(String, "bodies", self._on_solids, qos.STATUS)
        node.create_subscription(Float32MultiArray, "body_poses", self._on_poses, qos.SEEN)

    def _on_solids(self, message: String) -> None:
        self.solids = json.loads(message.data)
        self._outlet().send({"type": "bodies", "solids": self.solids})

    def _on_poses(self, message: Float32MultiArray) -> None:
        now_s = time.monotonic()
        if self._outlet().pages and now_s - self._sent_s > _LEAST_S:
            self._sent_s = now_s
            poses = np.array(message.data, dtype=float).reshape(-1, _NUMBERS)
            self._outlet().send({"type": "poses", "poses": poses.round(_DIGITS)})

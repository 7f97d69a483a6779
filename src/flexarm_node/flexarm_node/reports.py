"""Reports on `/diagnostics`: named so that two arms, and two nodes of one, are told apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from flexarm_node import qos
from flexarm_node.stamps import set_stamp

if TYPE_CHECKING:
    from rclpy.node import Node

    from flexarm_node.node_time import NodeTime


class Reporter:
    """Publisher of one node's status.

    Parameters
    ----------
    node : Node
        Its full name is that of the status, its namespace the arm.
    node_time : NodeTime
        Time of the node, for the stamps.
    """

    def __init__(self, node: Node, node_time: NodeTime) -> None:
        self._node = node
        self._time = node_time
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", qos.SENT)

    def publish(self, status: DiagnosticStatus, rig: str = "") -> None:
        """Publish a status, with the arm and the rig of the node as its hardware."""
        status.name = self._node.get_fully_qualified_name()
        status.hardware_id = f"{self._node.get_namespace()} {rig}".strip()
        message = DiagnosticArray(status=[status])
        set_stamp(message.header.stamp, self._time.now_ns())
        self._publisher.publish(message)

"""Topics of the bodies of an arm: what they are made of, once, and where they are, 20 a second."""

from __future__ import annotations

import json
from array import array
from typing import TYPE_CHECKING

from std_msgs.msg import Float32MultiArray, String

from flexarm_daq.rigs.rig_protocol import bodies_of
from flexarm_node import qos

if TYPE_CHECKING:
    from flexarm_daq.rigs.rig_protocol import Bodies, Rig
    from flexarm_node.loop_node import LoopNode

_POSES_HZ = 20.0


class BodyTopics:
    """Topics `bodies` and `body_poses`, silent for a rig without bodies.

    A pose is a row of seven numbers, as of `Bodies.poses`: as `geometry_msgs/PoseArray` it would
    take ten times as long, in the thread that samples.

    Parameters
    ----------
    node : LoopNode
        Owner of the topics.
    """

    def __init__(self, node: LoopNode) -> None:
        self._node = node
        self._solids = node.create_publisher(String, "bodies", qos.STATUS)
        self._poses = node.create_publisher(Float32MultiArray, "body_poses", qos.NEWEST)
        self._bodies: Bodies | None = None
        self._every = 1

    def start(self, rig: Rig, rate_hz: float) -> None:
        """Prepare for a run."""
        self._bodies = bodies_of(rig)
        self._every = max(1, round(rate_hz / _POSES_HZ))

    def publish(self, sequence: int) -> None:
        """Publish what is due with a sample of the open rig."""
        if self._bodies is None:
            return
        if sequence == 1:
            self._solids.publish(String(data=json.dumps(self._bodies.solids())))
        if sequence % self._every == 0 and self._poses.get_subscription_count():
            poses = array("f", self._bodies.poses().ravel())
            self._poses.publish(Float32MultiArray(data=poses))

    def close(self) -> None:
        """Release the topics."""
        self._node.destroy_publisher(self._solids)
        self._node.destroy_publisher(self._poses)

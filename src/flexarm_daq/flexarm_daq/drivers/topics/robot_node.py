"""Node that hears a robot and commands it, in a thread and a context of its own."""

from __future__ import annotations

import time
from operator import attrgetter
from threading import Thread
from typing import TYPE_CHECKING, Any, Final

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64, Float64MultiArray

from flexarm_daq.drivers.topics.inbox import FIELDS, JOINT_KINDS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_daq.drivers.topics.inbox import Inbox, TopicsSettings

# Takes what a publisher of any reliability sends, and the newest alone.
_HEARD: Final = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_SENT: Final = QoSProfile(depth=1)
_MESSAGES: Final = {"imu": (Imu, ""), "wrench": (WrenchStamped, "wrench."), "float": (Float64, "")}
_POLL_S: Final = 0.02


class RobotNode:
    """Subscriptions of the sources of a rig, and the publisher of its commands.

    Parameters
    ----------
    settings : TopicsSettings
        Topics.
    inbox : Inbox
        Takes what comes, in the node's thread.
    """

    def __init__(self, settings: TopicsSettings, inbox: Inbox) -> None:
        self._context = Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("flexarm_robot", context=self._context)
        self._commands = self._node.create_publisher(Float64MultiArray, settings.commands, _SENT)

        def heard(state: JointState) -> None:
            stamp_s = state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec
            values = {kind: getattr(state, kind) for kind in JOINT_KINDS}
            inbox.joints(stamp_s, state.name, values)

        self._node.create_subscription(JointState, settings.joint_states, heard, _HEARD)
        for kind, topic in {(each.kind, each.name) for each in settings.sources}:
            if kind in _MESSAGES:
                message = _MESSAGES[kind][0]
                self._node.create_subscription(message, topic, _reader(inbox, kind, topic), _HEARD)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = Thread(target=self._spin, name="robot", daemon=True)
        self._thread.start()

    def await_listener(self, patience_s: float) -> bool:
        """Wait for a reader of the commands; return whether there is one."""
        until_s = time.monotonic() + patience_s
        while not self.has_listener() and time.monotonic() < until_s:
            time.sleep(_POLL_S)
        return self.has_listener()

    def has_listener(self) -> bool:
        """Return whether anybody reads the commands."""
        return bool(self._commands.get_subscription_count())

    def other_reader(self) -> str:
        """Return who reads the topic of the commands, and what it wants; empty without any."""
        found = self._node.get_subscriptions_info_by_topic(self._commands.topic_name)
        if not found:
            return ""
        kept = found[0].qos_profile.durability.name.lower()
        return (
            f"{found[0].node_name} wants {found[0].topic_type} ({kept}) on it, and the driver "
            "sends std_msgs/msg/Float64MultiArray (volatile)"
        )

    def command(self, values: Sequence[float]) -> None:
        """Publish a command."""
        self._commands.publish(Float64MultiArray(data=list(values)))

    def close(self) -> None:
        """Leave the graph; what was published goes out first."""
        self._executor.shutdown(timeout_sec=1.0)
        self._thread.join(1.0)
        self._node.destroy_node()
        self._context.try_shutdown()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return


def _reader(inbox: Inbox, kind: str, topic: str) -> Callable[[Any], None]:
    prefix = _MESSAGES[kind][1]
    getters = {field: attrgetter(prefix + field) for field in FIELDS[kind]}

    def heard(message: Any) -> None:  # noqa: ANN401 - one of three messages
        inbox.reading(kind, topic, {field: get(message) for field, get in getters.items()})

    return heard

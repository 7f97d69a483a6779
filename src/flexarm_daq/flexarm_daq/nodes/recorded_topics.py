"""Topics that can be recorded: types, definitions and quality of service."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log, ParameterEvent
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, String

from flexarm_bags.metadata import RecordedTopic, TopicQos
from flexarm_bags.schema import describe, own_types, share_of
from flexarm_msgs.msg import (
    ArmState,
    ChannelInfo,
    CommanderInfo,
    IoCommand,
    IoSample,
    LawInForce,
    MotorCommand,
    PayloadEstimate,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.qos import QoSProfile

TOPICS = {
    "commander": (CommanderInfo, "flexarm_msgs/msg/CommanderInfo"),
    "io_channels": (ChannelInfo, "flexarm_msgs/msg/ChannelInfo"),
    "rig_description": (String, "std_msgs/msg/String"),
    "state": (ArmState, "flexarm_msgs/msg/ArmState"),
    "command": (MotorCommand, "flexarm_msgs/msg/MotorCommand"),
    "reference": (Float64, "std_msgs/msg/Float64"),
    "law": (LawInForce, "flexarm_msgs/msg/LawInForce"),
    "joint_states": (JointState, "sensor_msgs/msg/JointState"),
    "io": (IoSample, "flexarm_msgs/msg/IoSample"),
    "io_command": (IoCommand, "flexarm_msgs/msg/IoCommand"),
    "io_reference": (Float64MultiArray, "std_msgs/msg/Float64MultiArray"),
    "payload": (PayloadEstimate, "flexarm_msgs/msg/PayloadEstimate"),
    "/diagnostics": (DiagnosticArray, "diagnostic_msgs/msg/DiagnosticArray"),
    "/rosout": (Log, "rcl_interfaces/msg/Log"),
    "/parameter_events": (ParameterEvent, "rcl_interfaces/msg/ParameterEvent"),
}
"""Topics that can be recorded: message type and its name.

Those that tell about others stand first: they are read before the samples that they describe.
"""

OF_ALL_NODES = frozenset(name for name in TOPICS if name.startswith("/"))
"""Topics that every node may publish, or does."""

IN_FORCE = frozenset(
    {"commander", "io_channels", "io_reference", "payload", "reference", "rig_description"}
)
"""Topics whose last message is in force until the next one comes, and belongs into every bag."""

# Their publishers keep the last message for a latecomer.
_LATCHED = IN_FORCE | {"/rosout"}


def recorded_topics(names: Sequence[str], resolved: Sequence[str]) -> list[RecordedTopic]:
    """Return topics of the table with their full names, and the QoS that flexarm offers."""
    typestore = own_types()
    return [
        RecordedTopic(
            topic,
            describe(typestore, TOPICS[name][1], share_of),
            TopicQos(durability="transient_local" if name in _LATCHED else "volatile"),
        )
        for name, topic in zip(names, resolved, strict=True)
    ]


def is_best_effort(profile: QoSProfile) -> bool:
    """Return whether what is lost on its way is not sent again."""
    return bool(profile.reliability == ReliabilityPolicy.BEST_EFFORT)


def offered_qos(profiles: Sequence[QoSProfile]) -> TopicQos:
    """Return what several publishers of a topic offer: a viewer of the replay misses nothing."""
    latched = any(each.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in profiles)
    reliable = any(each.reliability == ReliabilityPolicy.RELIABLE for each in profiles)
    return TopicQos(
        reliability="reliable" if reliable else "best_effort",
        durability="transient_local" if latched else "volatile",
        lifespan_ns=max(each.lifespan.nanoseconds or TopicQos.lifespan_ns for each in profiles),
    )

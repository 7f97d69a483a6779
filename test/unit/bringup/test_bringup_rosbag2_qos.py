from __future__ import annotations

import yaml
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)

from flexarm_daq.nodes.recorded_topics import TOPICS, recorded_topics
from flexarm_node import qos
from support.project import PROJECT

FILE = PROJECT / "src/flexarm_bringup/config/rosbag2_qos.yaml"


def test_overrides_of_rosbag2___are_those_of_the_own_recorder() -> None:
    names = [name if name.startswith("/") else f"/flexarm/{name}" for name in TOPICS]
    own = {each.name: each.qos for each in recorded_topics([*TOPICS], names)}
    overrides = yaml.safe_load(FILE.read_text("utf-8"))
    assert list(overrides) == names
    for name, each in overrides.items():
        assert each["reliability"] == own[name].reliability
        assert each["durability"] == own[name].durability
        assert each["depth"] >= qos.SENT.depth


def test_overrides_of_rosbag2___fit_what_the_nodes_send() -> None:
    """A reader that asks for more than a writer offers hears nothing of it."""
    sent = {"volatile": qos.SENT, "transient_local": qos.STATUS_SENT}
    for each in yaml.safe_load(FILE.read_text("utf-8")).values():
        reader = QoSProfile(
            depth=each["depth"],
            reliability=ReliabilityPolicy[each["reliability"].upper()],
            durability=DurabilityPolicy[each["durability"].upper()],
        )
        found, _ = qos_check_compatible(sent[each["durability"]], reader)
        assert found != QoSCompatibility.ERROR

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from flexarm_bags.metadata import TopicQos
from flexarm_daq.nodes.recorded_topics import offered_qos


def profile(*, latched: bool, reliable: bool = True) -> QoSProfile:
    durability, reliability = DurabilityPolicy, ReliabilityPolicy
    return QoSProfile(
        depth=1,
        durability=durability.TRANSIENT_LOCAL if latched else durability.VOLATILE,
        reliability=reliability.RELIABLE if reliable else reliability.BEST_EFFORT,
    )


def test_offered_qos___one_publisher___is_its_own() -> None:
    assert offered_qos([profile(latched=True)]) == TopicQos(durability="transient_local")
    assert offered_qos([profile(latched=False, reliable=False)]) == TopicQos("best_effort")


def test_offered_qos___several_publishers___is_what_serves_every_viewer() -> None:
    found = offered_qos([profile(latched=False), profile(latched=True, reliable=False)])
    assert found == TopicQos("reliable", "transient_local")


def test_offered_qos___of_rosout___has_its_lifespan() -> None:
    seconds = [Duration(seconds=ten) for ten in (10, 5)]
    found = offered_qos([QoSProfile(depth=1, lifespan=each) for each in seconds])
    assert found.as_rosbag2()["lifespan"] == {"sec": 10, "nsec": 0}
    unlimited = offered_qos([profile(latched=False)]).as_rosbag2()["lifespan"]
    assert unlimited == {"sec": 9223372036, "nsec": 854775807}

"""What a record has of publishers that were there before it, or offer less than flexarm's."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Float64, String

from flexarm_bags.reader import opened
from flexarm_msgs.msg import ArmState, IoSample
from flexarm_node import qos
from support.exhaustive import first_of

if TYPE_CHECKING:
    from pathlib import Path

    from rclpy.publisher import Publisher
    from rclpy.qos import QoSProfile

    from support.system_graph import Graph

pytestmark = pytest.mark.system

SET_POINT_V = 1.5
SAMPLES = 500
FLOAT, SAMPLE = "std_msgs/msg/Float64", "flexarm_msgs/msg/IoSample"


def recorded(bag: Path, topic: str, kind: str) -> list[Any]:
    """Return the messages of a topic in a bag."""
    with opened(bag) as reader:
        return list(reader.messages(topic, kind))


def matched(graph: Graph, kind: type, topic: str, offered: QoSProfile, readers: int) -> Publisher:
    """Return a publisher that so many subscriptions match."""
    publisher = graph.node.create_publisher(kind, topic, offered)
    graph.wait(lambda: publisher.get_subscription_count() >= readers, "the recorder")
    return publisher


def written(reports: list[DiagnosticArray]) -> int:
    """Return how many messages the recorder last reported."""
    values = {each.key: each.value for each in reports[-1].status[0].values} if reports else {}
    return int(values.get("messages", 0))


@pytest.mark.parametrize("offered", first_of(["latched", "volatile"]))
def test_record___begun_in_mid_run___has_the_set_point_in_force(
    graph: Graph, tmp_path: Path, offered: str
) -> None:
    states = graph.node.create_publisher(ArmState, "state", qos.SENT)
    reports: list[DiagnosticArray] = []
    graph.node.create_subscription(DiagnosticArray, "/diagnostics", reports.append, qos.EVERY)
    if offered == "latched":
        # Said before there is a recorder, which hears it by both of its subscriptions.
        sender = graph.node.create_publisher(Float64, "reference", qos.STATUS)
        sender.publish(Float64(data=SET_POINT_V))
        graph.start("recorder", {"topics": ["state", "reference"]})
        graph.wait(lambda: sender.get_subscription_count() >= 2, "the recorder")
    else:
        graph.start("recorder", {"topics": ["state", "reference"]})
        sender = matched(graph, Float64, "reference", qos.SENT, 1)
        for _ in range(10):
            # A reader that finds its writer late misses what is volatile.
            sender.publish(Float64(data=SET_POINT_V))
            time.sleep(0.1)
    graph.wait(lambda: states.get_subscription_count() >= 1, "the recorder")
    bag = tmp_path / "bag"

    graph.operator.record(str(bag))
    states.publish(ArmState(sequence=1))
    # Each topic has a way of its own, and a newer set-point takes the place of one in force.
    graph.wait(lambda: written(reports) >= 2, "the first sample in the bag")
    sender.publish(Float64(data=-SET_POINT_V))
    states.publish(ArmState(sequence=2))
    graph.operator.record(None)

    volts = [message.data for message in recorded(bag, "/flexarm/reference", FLOAT)]
    np.testing.assert_allclose(volts, [SET_POINT_V, -SET_POINT_V])
    assert len(recorded(bag, "/flexarm/state", "flexarm_msgs/msg/ArmState")) == 2


def test_record___of_best_effort_publisher___has_its_samples_and_says(
    graph: Graph, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    recorder = graph.start("recorder", {"topics": ["io"], "bag": str(bag)})
    reliable = matched(graph, IoSample, "io", qos.SENT, 1)
    reliable.publish(IoSample(sequence=1))
    publisher = matched(graph, IoSample, "io", qos.SEEN, 1)

    for number in range(2, SAMPLES + 2):
        publisher.publish(IoSample(sequence=number))
        time.sleep(1e-3)
    reliable.publish(IoSample(sequence=SAMPLES + 2))

    assert graph.stop(recorder) == 0
    numbers = [message.sequence for message in recorded(bag, "/flexarm/io", SAMPLE)]
    assert len(set(numbers)) == len(numbers)
    # None is lost here but where the machine stops the recorder for long.
    assert len(numbers) > 0.9 * SAMPLES
    assert {1, SAMPLES + 2} <= set(numbers)
    assert "/flexarm/io: " in recorder.printed
    assert "publishes as best effort: what is lost on the way is not sent again" in recorder.printed


def test_record___of_another_type___is_reported(graph: Graph) -> None:
    recorder = graph.start("recorder", {"topics": ["io"]})
    graph.node.create_publisher(String, "io", qos.SENT)
    recorder.wait_for(f"publishes std_msgs/msg/String, and {SAMPLE} is recorded")

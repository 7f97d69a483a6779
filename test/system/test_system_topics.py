"""Topics of the loop as bytes: what others send there is read too."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from std_msgs.msg import Header

from flexarm_msgs.msg import MotorCommand
from flexarm_node import qos
from flexarm_node.topics.layout import Layout
from flexarm_node.topics.waiting import TopicWaiter
from support.system_graph import PATIENCE_S

if TYPE_CHECKING:
    from support.system_graph import Graph

pytestmark = pytest.mark.system

FRAME = "flexarm/base_link"


def test_waiter___reads_any_frame_and_drops_what_is_no_message(graph: Graph) -> None:
    layout = Layout(MotorCommand, {"header.frame_id": FRAME})
    waiter = TopicWaiter(graph.node, layout, "command", qos.NEWEST)
    publisher = graph.node.create_publisher(MotorCommand, "command", qos.SENT)
    graph.wait(lambda: publisher.get_subscription_count() == 1, "the reader")
    raw = layout.pack(1, 2, 3, 4, 5.0, 6.0)

    for frame in (FRAME, "", "arm of somebody"):
        message = MotorCommand(header=Header(frame_id=frame), sequence=7, effort_v=-1.5)
        publisher.publish(message)
        found = waiter.wait_newest(PATIENCE_S)
        assert found is not None
        assert (found.sequence, found.effort_v) == (7, -1.5)
    for wrong in (b"", raw[:30], b"\xff" * len(raw), raw[:16] + b"\xff" + raw[17:20]):
        publisher.publish(wrong)
        assert waiter.wait_newest(0.2) is None
    publisher.publish(raw)
    assert tuple(waiter.wait_newest(PATIENCE_S) or ()) == (1, 2, 3, 4, 5.0, 6.0)
    waiter.close()

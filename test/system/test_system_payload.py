"""The controller weighs the payload on the live graph and says so."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from flexarm_msgs.msg import PayloadEstimate
from flexarm_node import qos

if TYPE_CHECKING:
    from support.system_graph import Graph

pytestmark = pytest.mark.system


@pytest.mark.exhaustive
def test_scheduled_controller___publishes_the_payload_that_it_detects(graph: Graph) -> None:
    heard: list[PayloadEstimate] = []
    graph.node.create_subscription(PayloadEstimate, "payload", heard.append, qos.STATUS)
    graph.start("daq", {"real_time_factor": 0.0, "payload_kg": 0.3, "samples": 900, "seed": 2})
    graph.start(
        "controller",
        {"law": "pdpc_scheduled", "reference": "step", "step.amplitude_v": 4.0},
    )
    graph.activate_loop()
    # In virtual time the run may be over before discovery.
    graph.wait(lambda: graph.node.count_publishers("/flexarm/payload") == 1, "the topic")

    assert graph.transition("daq", "activate")

    graph.wait(lambda: any(each.detected for each in heard), "a detected payload")
    graph.await_state("daq", "inactive")
    # On a busy machine the first ones, without a detection, are gone before this reader is known.
    assert heard[-1].payload_kg == pytest.approx(0.3, abs=0.06)
    assert heard[-1].deviation_kg < 0.08

"""Snapshots of a running graph, split files, and the replay of a snapshot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from flexarm_bags.check import check_bag
from flexarm_msgs.msg import ArmState
from flexarm_msgs.srv import SetReference
from flexarm_node import qos
from support.bag_samples import information
from support.recorded_samples import States, content

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph

pytestmark = pytest.mark.system

KEPT_S = 1.0
RATE_HZ = 100.0


def snapshot(graph: Graph) -> Trigger.Response:
    """Have the recorder write what it keeps."""
    response = graph.call(Trigger, "recorder/snapshot", Trigger.Request())
    assert isinstance(response, Trigger.Response)
    return response


@pytest.mark.exhaustive
def test_snapshot___holds_the_last_second_and_the_set_point_that_a_late_viewer_of_it_gets(
    graph: Graph, tmp_path: Path
) -> None:
    bag = tmp_path / "last"
    reported = {
        "bag": str(bag),
        "topics": ["commander", "state", "command", "reference", "/diagnostics", "/rosout"],
        "snapshot_mode": True,
        "snapshot_duration": KEPT_S,
    }
    recorder = graph.start("recorder", reported)
    recorder.wait_for("recording to")
    states: list[int] = []
    watcher = graph.node.create_subscription(
        ArmState, "state", lambda state: states.append(state.sequence), qos.EVERY
    )
    graph.start("controller", {"law": "pd"})
    graph.start("daq", {"rate_hz": RATE_HZ})
    graph.activate_loop()
    graph.operator.activate("daq")
    request = SetReference.Request(reference_v=1.5)
    assert graph.call(SetReference, "set_reference", request).success
    # The set-point must have become too old to be kept as a message of the last second.
    before = len(states)
    graph.wait(lambda: len(states) > before + 2 * RATE_HZ * KEPT_S, "two seconds")

    answer = snapshot(graph)

    assert answer.success, answer.message
    assert f"in {bag}" in answer.message
    # While the recorder goes on, the bag is whole.
    checked = check_bag(bag)
    assert (checked.problems, checked.samples > 0) == ((), True)
    recorded = States(bag)
    assert np.all(np.diff(recorded.sequence) == 1)
    assert recorded.sequence[-1] > before + RATE_HZ * KEPT_S
    # Of two seconds of samples, so many as were sent in the last one: less when the machine stalls.
    # A late answer is asked for again: a second file has what was sent meanwhile.
    first = information(bag)["files"][0]  # type: ignore[index]
    assert first["duration"]["nanoseconds"] <= KEPT_S * 1e9
    assert recorded.sequence[0] > before
    # A set-point whose answer was late is asked for twice: the second time perhaps a second later.
    assert len(set(content(bag)["/flexarm/reference"])) == 1

    before = len(states)
    graph.wait(lambda: len(states) > before + 10, "more samples")
    assert snapshot(graph).success
    files = information(bag)["relative_file_paths"]
    assert files[:2] == ["last_0.mcap", "last_1.mcap"]  # type: ignore[index]
    graph.node.destroy_subscription(watcher)

    heard: list[float] = []
    played: list[ArmState] = []
    names = ("state", "command", "reference", "commander")
    away = [word for name in names for word in ("-r", f"/flexarm/{name}:=/away/{name}")]
    graph.node.create_subscription(ArmState, "/away/state", played.append, qos.EVERY)
    player = graph.start("player", {"bag": str(bag), "rate": 0.25}, *away)
    graph.wait(lambda: len(played) > 10, "the replay")
    graph.node.create_subscription(
        Float64, "/away/reference", lambda each: heard.append(each.data), qos.STATUS
    )
    graph.wait(lambda: bool(heard), "the set-point")
    # The live nodes publish some of the topics too, as every node does.
    assert heard[0] == pytest.approx(1.5)
    graph.stop(player)

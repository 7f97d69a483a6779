"""Node for viewers of the Foxglove protocol, with the real package where it is installed."""

from __future__ import annotations

import socket
from contextlib import closing
from itertools import islice
from typing import TYPE_CHECKING

import pytest

from flexarm_bags.schema import describe, own_types, share_of
from flexarm_bags.sequence import sequence_of
from support.foxglove_client import FoxgloveClient
from support.project import PROJECT
from support.system_graph import PATIENCE_S

if TYPE_CHECKING:
    from support.system_graph import Graph

pytestmark = pytest.mark.system
STATE, DESCRIPTION, FRAMES = "/flexarm/state", "/flexarm/robot_description", "/tf"
URDF = PROJECT / "src/flexarm_bringup/urdf/flexarm.urdf"


def test_viewer___gets_every_sample_and_the_arm(graph: Graph) -> None:
    pytest.importorskip("foxglove", reason="pip install -r requirements/foxglove.in")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    node = graph.start("foxglove", {"port": port, "urdf": str(URDF)})
    node.wait_for(f"ws://127.0.0.1:{port}")

    with closing(FoxgloveClient(port, PATIENCE_S)) as viewer:
        viewer.subscribe([STATE, DESCRIPTION, FRAMES])
        messages = viewer.messages()
        description = next(messages)
        graph.start(
            "daq",
            {"autostart": True, "time": "virtual", "rate_hz": 100.0}
            | {"answer_timeout_s": 0.05, "listeners": 1},
        )
        received = list(islice(messages, 40))
        reported = viewer.channels

    assert description.topic == DESCRIPTION
    assert URDF.read_bytes() in description.raw
    numbers = [sequence_of(each.raw) for each in received if each.topic == STATE]
    assert numbers == list(range(1, len(numbers) + 1))
    assert {each.topic for each in received} == {STATE, FRAMES}
    # The text that the recorder writes into a bag.
    recorded = describe(own_types(), "flexarm_msgs/msg/ArmState", share_of)
    assert reported[STATE]["schema"] == recorded.text


def test_port_that_is_taken___ends_the_node_with_one_line(graph: Graph) -> None:
    pytest.importorskip("foxglove", reason="pip install -r requirements/foxglove.in")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        node = graph.run_node("foxglove", {"port": port})
        assert node.exit_code() == 2
    (line,) = node.printed.splitlines()
    assert line.startswith(f"foxglove: cannot listen on 127.0.0.1 port {port}: ")


def test_node___without_the_package___ends_with_one_line(graph: Graph) -> None:
    missing = graph.folder / "foxglove.py"
    missing.write_text("raise ImportError\n")
    graph.environment["PYTHONPATH"] = f"{graph.folder}:{graph.environment['PYTHONPATH']}"
    node = graph.run_node("foxglove", {})
    assert node.exit_code() == 2
    assert node.printed == "foxglove needs foxglove-sdk: pip install -r requirements/foxglove.in\n"

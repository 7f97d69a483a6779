from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import pytest
from system_graph import ROOT, States

from flexarm_msgs.msg import ArmState
from flexarm_node import qos

if TYPE_CHECKING:
    from pathlib import Path

    from system_graph import Graph

pytestmark = pytest.mark.system


def test_up___samples_and_records_until_ctrl_c(graph: Graph, tmp_path: Path) -> None:
    bag = tmp_path / "new" / "bag"
    heard: list[ArmState] = []
    graph.node.create_subscription(ArmState, "/flexarm/state", heard.append, qos.NEWEST)
    arguments = ("--rate", "100", "--payload", "0.2", "--reference", "square", "--bag", str(bag))
    process = graph.run([str(ROOT / "flexarm"), "up", *arguments])
    process.wait_for("/flexarm is up: PDPC at 100 Hz, reference: square. Ctrl-C ends it.")
    graph.wait(lambda: any(state.command_v for state in heard), "a driven sample")
    last = heard[-1].sequence

    process.send(signal.SIGINT)

    assert process.exit_code() == 0, process.printed
    assert process.printed.splitlines()[-2:] == ["stopping", f"recorded in {bag}"]
    states = States(bag)
    assert states.sequence[0] == 1
    assert states.sequence[-1] >= last
    assert (states.sequence[1:] - states.sequence[:-1] == 1).all()
    assert states.command_v.any()

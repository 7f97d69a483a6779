"""Replay of what real nodes recorded, from the middle of a run on and through every change."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from flexarm_control.replaying.comparison import read_loop, replay
from flexarm_msgs.msg import LawInForce
from flexarm_msgs.srv import SetReference
from flexarm_node import qos

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from support.system_graph import Graph

pytestmark = pytest.mark.system

# The law is told once a second of the arm's time, in which so many samples are taken.
TOLD_EVERY = 300


@pytest.mark.exhaustive
def test_record_from_mid_run___with_changes_and_a_second_activation___replays_to_the_bit(
    graph: Graph, tmp_path: Path
) -> None:
    reported: list[LawInForce] = []
    graph.node.create_subscription(LawInForce, "law", reported.append, qos.EVERY)
    graph.start("recorder")
    graph.start("controller", {"law": "pi"})
    # The gate cuts, which the laws hear.
    graph.start("daq", {"real_time_factor": 5.0, "max_command_v": 0.3})
    graph.activate_loop()
    graph.operator.start_sampling()

    def await_reported(holds: Callable[[LawInForce], bool]) -> None:
        before = len(reported)
        graph.wait(lambda: any(map(holds, reported[before:])), "the law")

    def parameter(message: LawInForce, name: str) -> object:
        return json.loads(message.parameters).get(name)

    await_reported(lambda _: True)
    graph.operator.record(str(tmp_path / "bag"))
    await_reported(lambda _: True)
    graph.operator.set_parameters("controller", {"pi.kp": 0.6})
    await_reported(lambda message: parameter(message, "pi.kp") == pytest.approx(0.6))
    request = SetReference.Request(reference_v=1.0)
    assert graph.call(SetReference, "set_reference", request).success
    await_reported(lambda message: message.reference_v == pytest.approx(1.0))
    graph.operator.set_parameters("controller", {"law": "lqg"})
    await_reported(lambda message: parameter(message, "law") == "lqg")
    graph.operator.deactivate("controller")
    graph.operator.activate("controller")
    await_reported(lambda message: message.command_sequence == 1)
    await_reported(lambda _: True)
    graph.operator.deactivate("controller")
    graph.operator.record(None)

    found = replay(read_loop(tmp_path / "bag"))

    assert found.differences == ()
    assert [change.text for change in found.changes] == ["pi.kp 0.3998 to 0.6", "law pi to lqg"]
    # After the second activation a second of samples was waited for.
    assert found.compared >= max(TOLD_EVERY, found.commands - TOLD_EVERY)

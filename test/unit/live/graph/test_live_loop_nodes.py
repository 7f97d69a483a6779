"""Transitions of the nodes of the loop, asked of services that a double answers."""

from __future__ import annotations

import asyncio
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from lifecycle_msgs.msg import State

from flexarm_core.rig_description import load_rig
from flexarm_live.graph.loop_nodes import LoopNodes
from flexarm_live.graph.node_parameters import CallError
from flexarm_live.graph.situation import Situation
from flexarm_node.codecs import codec_of

if TYPE_CHECKING:
    from collections.abc import Callable

HELD = "active: the drive is held at zero: position_v is stuck"


class ActiveNodes:
    """Services of nodes that are all active."""

    def client(self, *_: object) -> None:
        """Need no discovery."""

    async def call(self, *_: object) -> Any:  # noqa: ANN401 - an answer of any service
        """Tell the state."""
        return SimpleNamespace(current_state=State(id=State.PRIMARY_STATE_ACTIVE))


def activate(name: str, situation: Situation) -> None:
    codec = codec_of(load_rig("thesis"), "")
    loop = LoopNodes(SimpleNamespace(), ActiveNodes(), situation, codec)  # type: ignore[arg-type]
    asyncio.run(loop.activate(name))


def stopped(situation: Situation) -> None:
    situation.hear("daq", 0, "active", {"drive": "driving"}, time.monotonic())
    situation.stopped(time.monotonic())


def failed(situation: Situation) -> None:
    situation.hear("daq", 2, HELD, {"drive": "held"}, time.monotonic())


def driving(situation: Situation) -> None:
    situation.hear("daq", 0, "active", {"drive": "driving"}, time.monotonic())


@pytest.mark.parametrize(
    ("happen", "reason"), [(stopped, "emergency stop"), (failed, "position_v is stuck")]
)
def test_activation___of_a_drive_that_is_held___is_refused_with_the_way_out(
    happen: Callable[[Situation], None], reason: str
) -> None:
    situation = Situation()
    happen(situation)
    wanted = f"daq is active, but the drive is held at zero: {reason}; deactivate daq ends that"
    with pytest.raises(CallError, match=f"^{wanted}$"):
        activate("daq", situation)


@pytest.mark.parametrize(("name", "happen"), [("daq", driving), ("controller", failed)])
def test_activation___of_what_is_active_and_not_held___leaves_it(
    name: str, happen: Callable[[Situation], None]
) -> None:
    situation = Situation()
    happen(situation)
    activate(name, situation)

"""The nodes of the loop: their parameters, their transitions, and a run begun anew."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState

from flexarm_live.graph.node_parameters import CallError, NodeParameters
from flexarm_live.graph.situation import EXPERIMENT
from flexarm_node.parameter_files import LOOP

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rclpy.node import Node

    from flexarm_live.graph.node_parameters import Calls
    from flexarm_live.graph.situation import Situation
    from flexarm_node.codecs import Codec

_SIMULATED = ("simulated", "thesis")
_TRANSITION_S = 60.0
"""Activating waits for readers, and for a commander."""


class LoopNodes:
    """Nodes of the loop, operated from the server's event loop.

    Parameters
    ----------
    node : Node
        Node whose graph knows the readers.
    calls : Calls
        Their services.
    situation : Situation
        Hears of transitions.
    codec : Codec
        Topics of the loop.

    Attributes
    ----------
    parameters : dict of str to NodeParameters
        Parameters of `LOOP`.
    experiment : NodeParameters
        Parameters of the node that takes the controller's place.
    """

    def __init__(self, node: Node, calls: Calls, situation: Situation, codec: Codec) -> None:
        self._node = node
        self._calls = calls
        self._situation = situation
        self.parameters = {name: NodeParameters(calls, name) for name in LOOP}
        self.experiment = NodeParameters(calls, EXPERIMENT)
        self._due: dict[str, Any] = {}
        # The first message of each node goes to this topic.
        self._sends = {
            "daq": codec.sample_topic,
            "controller": codec.command_topic,
            EXPERIMENT: codec.command_topic,
        }
        for name in self._sends:
            # Discovered before they are needed.
            calls.client(ChangeState, f"{name}/change_state")
            calls.client(GetState, f"{name}/get_state")

    @property
    def simulated(self) -> bool:
        """Whether the arm is the thesis's, simulated."""
        return self.parameters["daq"].values.get("rig") in _SIMULATED

    def postpone(self, changes: Mapping[str, Any]) -> None:
        """Keep parameters of the DAQ node for its next run."""
        self._due |= changes

    async def state(self, name: str) -> int:
        """Return the lifecycle state of a node."""
        answer = await self._calls.call(GetState, f"{name}/get_state", GetState.Request())
        return int(answer.current_state.id)

    async def is_active(self, name: str) -> bool:
        """Return whether a node is active."""
        return bool(await self.state(name) == State.PRIMARY_STATE_ACTIVE)

    async def activate(self, name: str) -> None:
        """Take a node to active; it waits for all readers that are known here.

        Raises
        ------
        CallError
            When it is the DAQ node, active already, and holds the drive at zero.
        """
        state = await self.state(name)
        if state == State.PRIMARY_STATE_ACTIVE:
            reason = self._situation.held(time.monotonic()) if name == "daq" else ""
            if reason:
                raise CallError(f"daq is active, but {reason}; deactivate daq ends that")
            return
        if state == State.PRIMARY_STATE_UNCONFIGURED:
            await self._change(name, Transition.TRANSITION_CONFIGURE)
        wanted: dict[str, Any] = {"listeners": self._node.count_subscribers(self._sends[name])}
        if name == "daq":
            wanted = {**self._due, **wanted, "await_commander": True}
            self._due.clear()
        parameters = self.experiment if name == EXPERIMENT else self.parameters[name]
        await parameters.set(wanted)
        await self._change(name, Transition.TRANSITION_ACTIVATE)
        self._situation.moved(name, active=True, now_s=time.monotonic())

    async def deactivate(self, name: str) -> None:
        """Take a node out of the loop, when it is in it; the drive goes to zero."""
        if await self.is_active(name):
            await self._change(name, Transition.TRANSITION_DEACTIVATE)
        self._situation.moved(name, active=False, now_s=time.monotonic())

    async def release(self, name: str) -> None:
        """Take a node out of the loop with its topics, so that no record has its old messages."""
        await self.deactivate(name)
        if await self.state(name) == State.PRIMARY_STATE_INACTIVE:
            await self._change(name, Transition.TRANSITION_CLEANUP)

    async def restart_sampling(
        self, changes: Mapping[str, Any] | None = None, *, samples: int = 0
    ) -> None:
        """Begin the run of the DAQ node anew, with changes that it takes only between two runs."""
        await self.deactivate("daq")
        self.postpone({"samples": samples, **(changes or {})})
        await self.activate("daq")

    async def _change(self, name: str, transition: int) -> None:
        request = ChangeState.Request(transition=Transition(id=transition))
        answer = await self._calls.call(
            ChangeState, f"{name}/change_state", request, _TRANSITION_S, again_s=math.inf
        )
        if not answer.success:
            raise CallError(f"{name} refused the transition: see its log")

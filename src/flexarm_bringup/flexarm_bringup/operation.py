"""The operator's end of the graph: transitions, parameters, services, all with deadlines."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool

from flexarm_bringup.processes import LaunchError
from flexarm_msgs.msg import ArmState
from flexarm_msgs.srv import Identify
from flexarm_node import qos

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rcl_interfaces.msg import Parameter as ParameterMessage
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

NAMESPACE = "/flexarm"
_SERVICE_S = 30.0
_IDENTIFY_S = 900.0
_STALLED_S = 30.0
_POLL_S = 0.1


class Operator:
    """Operates the nodes of one graph.

    Parameters
    ----------
    node, executor
        A node for the clients and the executor that spins it.
    check
        Called while waiting; raises when a process has ended.
    """

    def __init__(
        self, node: Node, executor: SingleThreadedExecutor, check: Callable[[], None]
    ) -> None:
        self._node = node
        self._executor = executor
        self._check = check
        self._sequence = 0

    def configure(self, name: str) -> None:
        """Take a managed node from unconfigured to inactive."""
        self._transition(name, Transition.TRANSITION_CONFIGURE, "configure")

    def activate(self, name: str) -> None:
        """Take a managed node from inactive to active."""
        self._transition(name, Transition.TRANSITION_ACTIVATE, "activate")

    def is_active(self, name: str) -> bool:
        """Return whether a managed node is active."""
        response = self._call(GetState, f"{name}/get_state", GetState.Request())
        return bool(response.current_state.id == State.PRIMARY_STATE_ACTIVE)

    def set_parameters(self, name: str, values: Mapping[str, Any]) -> None:
        """Set parameters of a node, all or none."""
        request = SetParametersAtomically.Request()
        request.parameters = [_message(key, value) for key, value in values.items()]
        response = self._call(SetParametersAtomically, f"{name}/set_parameters_atomically", request)
        if not response.result.successful:
            raise LaunchError(f"{name} refused: {response.result.reason}")

    def record(self, bag: str | None) -> str:
        """Start to record into a new bag, or stop with None; return what the recorder says."""
        if bag is not None:
            self.set_parameters("recorder", {"bag": bag})
        response = self._call(SetBool, "recorder/record", SetBool.Request(data=bag is not None))
        if not response.success:
            raise LaunchError(f"recorder: {response.message}")
        return str(response.message)

    def identify(self, request: Identify.Request) -> Identify.Response:
        """Call the identification service; its refusal becomes an error."""
        response = self._call(Identify, "identify", request, timeout_s=_IDENTIFY_S)
        if not response.success:
            raise LaunchError(f"identify: {response.message}")
        return response

    def sample(self, samples: int, progress: Callable[[int], None]) -> None:
        """Let the DAQ node take that many samples and wait until it has stopped by itself.

        Raises
        ------
        LaunchError
            When no new sample comes for a long time.
        """
        self._sequence = 0
        topic = f"{NAMESPACE}/state"
        subscription = self._node.create_subscription(ArmState, topic, self._on_state, qos.NEWEST)
        try:
            # The DAQ node may not have heard of all the readers that are known here.
            listeners = self._node.count_subscribers(topic)
            self.set_parameters("daq", {"samples": samples, "listeners": listeners})
            self.activate("daq")
            seen, seen_s = 0, time.monotonic()
            while self._sequence < samples:
                self._spin()
                if self._sequence != seen:
                    seen, seen_s = self._sequence, time.monotonic()
                    progress(seen)
                if time.monotonic() - seen_s > _STALLED_S:
                    if not self.is_active("daq"):
                        break
                    raise LaunchError(f"no new sample for {_STALLED_S:.0f} s after {seen}")
            deadline_s = time.monotonic() + _SERVICE_S
            while self.is_active("daq"):
                if time.monotonic() > deadline_s:
                    raise LaunchError("daq did not stop after its last sample")
            progress(samples)
        finally:
            self._node.destroy_subscription(subscription)

    def nodes(self) -> set[str]:
        """Return the full names of the nodes that are there."""
        return {
            f"{space.rstrip('/')}/{name}"
            for name, space in self._node.get_node_names_and_namespaces()
        }

    def wait(self, condition: Callable[[], bool], what: str, timeout_s: float = _SERVICE_S) -> None:
        """Spin until the condition holds.

        Raises
        ------
        LaunchError
            When it does not within the time.
        """
        deadline_s = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline_s:
                raise LaunchError(f"{what} did not come within {timeout_s:.0f} s")
            self._spin()

    def _spin(self) -> None:
        self._check()
        self._executor.spin_once(timeout_sec=_POLL_S)

    def _on_state(self, state: ArmState) -> None:
        self._sequence = state.sequence

    def _transition(self, name: str, transition: int, label: str) -> None:
        request = ChangeState.Request(transition=Transition(id=transition))
        if not self._call(ChangeState, f"{name}/change_state", request).success:
            raise LaunchError(f"{name} refused to {label}")

    def _call(
        self,
        service: type,
        name: str,
        request: object,
        timeout_s: float = _SERVICE_S,
    ) -> Any:  # noqa: ANN401 - the service's own response type
        client = self._node.create_client(service, f"{NAMESPACE}/{name}")
        try:
            self.wait(client.service_is_ready, f"service {NAMESPACE}/{name}")
            future = client.call_async(request)
            self.wait(future.done, f"the answer of {NAMESPACE}/{name}", timeout_s)
            return future.result()
        finally:
            self._node.destroy_client(client)


def _message(name: str, value: object) -> ParameterMessage:
    return Parameter(name, value=value).to_parameter_msg()

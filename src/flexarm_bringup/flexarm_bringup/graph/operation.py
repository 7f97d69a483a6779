"""The operator's end of the graph: transitions, parameters, services, all with deadlines."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.parameter import Parameter, parameter_value_to_python
from std_srvs.srv import SetBool

from flexarm_bringup.graph.processes import LaunchError
from flexarm_msgs.msg import ArmState
from flexarm_msgs.srv import Identify, Tune
from flexarm_node import qos
from flexarm_node.stamps import stamp_text

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rcl_interfaces.msg import Parameter as ParameterMessage
    from rclpy.client import Client
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from rclpy.task import Future

NAMESPACE = "/flexarm"
_STATE = f"{NAMESPACE}/state"
_SENDS = {
    "daq": _STATE,
    "controller": f"{NAMESPACE}/command",
    "experiment": f"{NAMESPACE}/command",
}
"""What the nodes with a loop send, first of all."""
_RECORD = "recorder/record"
_SERVICE_S = 30.0
_UNHEARD_S = 3.0
_READ_UNHEARD_S = 0.5
"""For questions that change nothing: they may be put again soon."""
_READS = (GetState, GetParameters)
_ASKED_ONCE = {Identify: "ident", Tune: "tuner"}
"""Long work and its node: a second question would be refused while the first is at work."""
_IDENTIFY_S = 900.0
_GOALS = {
    Transition.TRANSITION_CONFIGURE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_ACTIVATE: State.PRIMARY_STATE_ACTIVE,
    Transition.TRANSITION_DEACTIVATE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_CLEANUP: State.PRIMARY_STATE_UNCONFIGURED,
}
_STALLED_S = 30.0
_SLOWEST = 10
"""So many samples come within that time however slow the run; in virtual time one whose answer does
not come may take a third of it."""
_COMPLAINTS_S = 1.0
_POLL_S = 0.1


class Run(NamedTuple):
    """What the DAQ node says of a run that has ended.

    Attributes
    ----------
    taken
        Samples taken.
    missed
        Periods without a sample.
    real_time_factor
        How fast the arm's time has passed, for that of the wall clock.
    recorded
        What the recorder says; empty when nothing was recorded.
    """

    taken: int
    missed: int
    real_time_factor: float
    recorded: str = ""


class Operator:
    """Operates the nodes of one graph.

    Parameters
    ----------
    node, executor
        A node for the clients and the executor that spins it.
    check
        Called while waiting; raises when a process has ended.
    complaint
        Returns what a node, by its name, has last complained of, or nothing.
    """

    def __init__(
        self,
        node: Node,
        executor: SingleThreadedExecutor,
        check: Callable[[], None],
        complaint: Callable[[str], str] = lambda _: "",
    ) -> None:
        self._node = node
        self._executor = executor
        self._check = check
        self._complaint = complaint
        self._clients: dict[tuple[type, str], Client] = {}
        self._sequence = 0
        self._sampled_s = ""
        self._figures: dict[str, str] | None = None

    def configure(self, name: str) -> None:
        """Take a managed node from unconfigured to inactive."""
        if not self.transition(name, Transition.TRANSITION_CONFIGURE):
            raise LaunchError(f"{name} refused to configure{self._why(name)}")

    def activate(self, name: str) -> None:
        """Take a managed node from inactive to active, such that everybody hears its first message.

        It may not have heard of all the readers that are known here.
        """
        if name in _SENDS:
            listeners = self._node.count_subscribers(_SENDS[name])
            self.set_parameters(name, {"listeners": listeners})
        if not self.transition(name, Transition.TRANSITION_ACTIVATE):
            raise LaunchError(f"{name} refused to activate{self._why(name)}")

    def deactivate(self, name: str) -> None:
        """Take a managed node from active to inactive."""
        if not self.transition(name, Transition.TRANSITION_DEACTIVATE):
            raise LaunchError(f"{name} refused to deactivate")

    def transition(self, name: str, transition: int) -> bool:
        """Ask a managed node for a transition and return whether it made it."""
        before = self.state(name)

        def made() -> ChangeState.Response | None:
            now = self.state(name)
            # An activated DAQ node may have taken all its samples and stopped by now.
            if now.id == before.id and self._sequence == 0:
                return None
            return ChangeState.Response(success=now.id in (_GOALS[transition], before.id))

        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(self.call(ChangeState, f"{name}/change_state", request, unheard=made).success)

    def state(self, name: str) -> State:
        """Return the lifecycle state of a managed node."""
        state: State = self.call(GetState, f"{name}/get_state", GetState.Request()).current_state
        return state

    def is_active(self, name: str) -> bool:
        """Return whether a managed node is active."""
        return bool(self.state(name).id == State.PRIMARY_STATE_ACTIVE)

    def set_parameters(self, name: str, values: Mapping[str, Any]) -> None:
        """Set parameters of a node, all or none."""
        request = SetParametersAtomically.Request()
        request.parameters = [_message(key, value) for key, value in values.items()]
        response = self.call(SetParametersAtomically, f"{name}/set_parameters_atomically", request)
        if not response.result.successful:
            raise LaunchError(f"{name} refused: {response.result.reason}")

    def values(self, name: str, parameters: tuple[str, ...]) -> dict[str, Any]:
        """Return parameters of a node by their names."""
        request = GetParameters.Request(names=parameters)
        response = self.call(GetParameters, f"{name}/get_parameters", request)
        unknown = [
            parameter
            for parameter, value in zip(parameters, response.values, strict=False)
            if value.type == ParameterType.PARAMETER_NOT_SET
        ]
        if unknown or len(response.values) != len(parameters):
            raise LaunchError(f"{name} has no parameter {', '.join(unknown or parameters)}")
        values = map(parameter_value_to_python, response.values)
        return dict(zip(parameters, values, strict=True))

    def await_recorder(self) -> None:
        """Wait until the recorder and its readers are known here.

        Its service is the last that it announces.
        """
        self.wait(self._client(SetBool, _RECORD).service_is_ready, "the recorder")

    def record(self, bag: str | None) -> str:
        """Start to record into a new bag, or stop with None; return what the recorder says."""
        if bag is not None:
            self.set_parameters("recorder", {"bag": bag})
        response = self.call(SetBool, _RECORD, SetBool.Request(data=bag is not None))
        # The second answer, when the first one was lost.
        started = response.message == f"already recording to {bag}"
        if not (response.success or started):
            raise LaunchError(f"recorder: {response.message}")
        return str(response.message)

    def identify(self, request: Identify.Request) -> Identify.Response:
        """Call the identification service; its refusal becomes an error."""
        response = self.call(Identify, "identify", request, _IDENTIFY_S)
        if not response.success:
            raise LaunchError(f"identify: {response.message}")
        return response

    def start_sampling(self, samples: int = 0) -> None:
        """Activate the DAQ node, such that it waits for who commands.

        Parameters
        ----------
        samples
            Have it stop by itself after that many periods; 0: never.
        """
        self.set_parameters("daq", {"samples": samples, "await_commander": True})
        self.activate("daq")

    def sample(self, samples: int, progress: Callable[[int], None]) -> Run:
        """Let the DAQ node sample for so many periods and wait until it has stopped by itself.

        Raises
        ------
        LaunchError
            When hardly a new sample comes for a long time, the DAQ node ends too early, which is
            noticed within seconds, or the recorder has failed.
        """
        self._sequence = 0
        if self._figures is None:
            self.listen(DiagnosticArray, "/diagnostics", qos.EVERY, self._on_report)
        self._figures = {}
        subscription = self._node.create_subscription(ArmState, _STATE, self._on_state, qos.NEWEST)
        try:
            self.start_sampling(samples)
            seen, seen_s = 0, time.monotonic()
            asked, asked_s = 0, seen_s
            while self._sequence < samples:
                self._spin()
                progress(self._sequence)
                if time.monotonic() - asked_s > _COMPLAINTS_S:
                    self._check_recorder()
                    if self._sequence == asked and not self.is_active("daq"):
                        break
                    asked, asked_s = self._sequence, time.monotonic()
                if self._sequence >= seen + _SLOWEST:
                    seen, seen_s = self._sequence, time.monotonic()
                if time.monotonic() - seen_s > _STALLED_S:
                    raise LaunchError(
                        f"{self._sequence - seen} new samples in {_STALLED_S:.0f} s after {seen}"
                    )
            deadline_s = time.monotonic() + _SERVICE_S
            while self.is_active("daq"):
                if time.monotonic() > deadline_s:
                    raise LaunchError("daq did not stop after its last sample")
            progress(samples)
            self.wait(self._has_reported, "the figures of the run")
            figures = self._figures
            run = Run(
                int(figures["samples"]),
                int(figures["missed periods"]),
                float(figures["real-time factor"]),
            )
            if run.taken + run.missed < samples:
                raise LaunchError(
                    f"daq ended after {run.taken} of {samples} samples{self._why('daq')}"
                )
            return run
        finally:
            self._node.destroy_subscription(subscription)
            self._sequence = 0

    def recorded_run(
        self, commander: str, bag: str, samples: int, progress: Callable[[int], None]
    ) -> Run:
        """Record one run of the loop.

        Parameters
        ----------
        commander
            The node that commands; active for this run alone, since what it sent is complete when
            it has been deactivated.
        bag
            To be created.
        samples, progress
            As for `sample`.

        Raises
        ------
        LaunchError
            When a node does not do its part.
        """
        self.record(bag)
        self.activate(commander)
        run = self.sample(samples, progress)
        self.deactivate(commander)
        return run._replace(recorded=self.record(None))

    def listen(
        self, kind: type, topic: str, profile: QoSProfile, heard: Callable[[Any], None]
    ) -> None:
        """Hand every message of a topic to a function, while something is waited for."""
        self._node.create_subscription(kind, topic, heard, profile)

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

    def acquaint(self, name: str, timeout_s: float = _SERVICE_S) -> None:
        """Wait until a node knows all the clients and readers that were made here so far.

        Discovery announces them in the order in which they were made. So a node that answers the
        newest client knows all of them, and none of its later answers is dropped.

        Raises
        ------
        LaunchError
            When the node does not answer in time.
        """
        parameters = f"{NAMESPACE}/{name}/get_parameters"
        client = self._node.create_client(GetParameters, parameters)
        try:
            self._ask(client, GetParameters.Request(), timeout_s, patience_s=_READ_UNHEARD_S)
        finally:
            self._node.destroy_client(client)

    def call(
        self,
        service: type,
        name: str,
        request: object,
        timeout_s: float = _SERVICE_S,
        unheard: Callable[[], object | None] = lambda: None,
    ) -> Any:  # noqa: ANN401 - the service's own response type
        """Call a service below the namespace and return its response.

        A server that has not yet discovered the client's reader drops its answer. So the
        question is put again when no answer comes for a while.

        Parameters
        ----------
        service, name, request
            The service's type, its name below the namespace, and the question.
        timeout_s
            Deadline of the answer, in s.
        unheard
            Called when no answer came: what the answer must have been, or None to ask again.

        Raises
        ------
        LaunchError
            When the service or its answer does not come in time.
        """
        client = self._client(service, name)
        if service in _ASKED_ONCE:
            self.acquaint(_ASKED_ONCE[service], max(timeout_s, _SERVICE_S))
            return self._ask(client, request, timeout_s, patience_s=timeout_s)
        patience_s = _READ_UNHEARD_S if service in _READS else _UNHEARD_S
        return self._ask(client, request, timeout_s, patience_s=patience_s, unheard=unheard)

    def _ask(
        self,
        client: Client,
        request: object,
        timeout_s: float,
        *,
        patience_s: float,
        unheard: Callable[[], object | None] = lambda: None,
    ) -> Any:  # noqa: ANN401 - the service's own response type
        service = client.srv_name
        self.wait(client.service_is_ready, f"service {service}", max(timeout_s, _SERVICE_S))
        deadline_s = time.monotonic() + timeout_s
        answers: list[Future[Any]] = []
        while time.monotonic() < deadline_s:
            answers.append(client.call_async(request))
            until_s = min(time.monotonic() + patience_s, deadline_s)
            while time.monotonic() < until_s:
                for answer in answers:
                    if answer.done():
                        return answer.result()
                self._spin()
            if (inferred := unheard()) is not None:
                return inferred
        raise LaunchError(f"the answer of {service} did not come within {timeout_s:.0f} s")

    def _client(self, service: type, name: str) -> Client:
        # One client for all calls: only the first has to be discovered.
        key = (service, name)
        if key not in self._clients:
            self._clients[key] = self._node.create_client(service, f"{NAMESPACE}/{name}")
        return self._clients[key]

    def _why(self, name: str) -> str:
        complaint = self._complaint(name)
        return f": {complaint}" if complaint else ""

    def _check_recorder(self) -> None:
        if complaint := self._complaint("recorder"):
            raise LaunchError(f"recorder: {complaint}")

    def _spin(self) -> None:
        self._check()
        self._executor.spin_once(timeout_sec=_POLL_S)

    def _on_state(self, state: ArmState) -> None:
        self._sequence = state.sequence
        self._sampled_s = stamp_text(state.header.stamp)

    def _on_report(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "flexarm: daq":
                self._figures = {each.key: each.value for each in status.values}

    def _has_reported(self) -> bool:
        """Tell whether the newest figures are those of the run's last sample."""
        figures = self._figures or {}
        return figures.get("last sample s") == self._sampled_s and figures["drive"] == "off"


def _message(name: str, value: object) -> ParameterMessage:
    return Parameter(name, value=value).to_parameter_msg()

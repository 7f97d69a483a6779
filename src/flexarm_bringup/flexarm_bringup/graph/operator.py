"""Operator of the graph: transitions, parameters, recording and sampled runs."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters, ListParameters, SetParametersAtomically
from rclpy.parameter import Parameter, parameter_value_to_python
from std_srvs.srv import SetBool

from flexarm_bringup.graph.client import SERVICE_S, ServiceClient
from flexarm_bringup.graph.processes import HeldDriveError, LaunchError
from flexarm_bringup.graph.run_watch import RunWatch
from flexarm_core.nearest import nearest
from flexarm_core.patience import Patience
from flexarm_msgs.srv import Identify, SetReference

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rcl_interfaces.msg import ParameterValue
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

    from flexarm_bringup.graph.figures import Run

_COMMANDS = ("command", "io_command")
_SENDS = {"daq": ("state", "io"), "controller": _COMMANDS, "experiment": _COMMANDS}
"""The first message of each node with a loop goes to one of these topics."""
_RECORD = "recorder/record"
_IDENTIFY_S = 900.0
_GOALS = {
    Transition.TRANSITION_CONFIGURE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_ACTIVATE: State.PRIMARY_STATE_ACTIVE,
    Transition.TRANSITION_DEACTIVATE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_CLEANUP: State.PRIMARY_STATE_UNCONFIGURED,
}
_COMPLAINTS_S = 1.0


class Operator(ServiceClient):
    """Operator of the nodes of one graph.

    Parameters
    ----------
    node, executor, check
        As for `ServiceClient`.
    complaint : callable
        Returns the last complaint of a node, by its name, or nothing.
    """

    def __init__(
        self,
        node: Node,
        executor: SingleThreadedExecutor,
        check: Callable[[], None],
        complaint: Callable[[str], str] = lambda _: "",
    ) -> None:
        super().__init__(node, executor, check)
        self._complaint = complaint
        self._watch = RunWatch(node)

    def configure(self, name: str) -> None:
        """Take a managed node from unconfigured to inactive."""
        if not self.transition(name, Transition.TRANSITION_CONFIGURE):
            raise LaunchError(f"{name} refused to configure{self._why(name)}")

    def activate(self, name: str) -> None:
        """Take a managed node to active; it waits for all readers that are known here."""
        if name in _SENDS:
            listeners = max(map(self.node.count_subscribers, _SENDS[name]))
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
            if now.id == before.id and self._watch.sequence == 0:
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
        request.parameters = [
            Parameter(key, value=value).to_parameter_msg() for key, value in values.items()
        ]
        response = self.call(SetParametersAtomically, f"{name}/set_parameters_atomically", request)
        if not response.result.successful:
            raise LaunchError(f"{name} refused: {response.result.reason}")

    def set_reference(self, value: float, joint: str = "") -> SetReference.Response:
        """Give the controller a set-point; a `LaunchError` when it is refused."""
        request = SetReference.Request(reference_v=value, joint=joint)
        response: SetReference.Response = self.call(SetReference, "set_reference", request)
        if not response.success:
            raise LaunchError(str(response.message))
        return response

    def values(self, name: str, parameters: tuple[str, ...]) -> dict[str, Any]:
        """Return parameters of a node by their names."""
        found = self._values(name, parameters)
        if not found:  # a node answers with nothing when it does not know one of them
            unknown = [each for each in parameters if not self._values(name, (each,))]
            known = self.call(ListParameters, f"{name}/list_parameters", ListParameters.Request())
            named = (f"{each}{nearest(each, known.result.names)}" for each in unknown or parameters)
            raise LaunchError(f"{name} has no parameter {', '.join(named)}")
        return dict(zip(parameters, map(parameter_value_to_python, found), strict=True))

    def _values(self, name: str, parameters: tuple[str, ...]) -> Sequence[ParameterValue]:
        """Return parameter values; none when one is unknown or not set."""
        request = GetParameters.Request(names=parameters)
        values = self.call(GetParameters, f"{name}/get_parameters", request).values
        known = [each for each in values if each.type != ParameterType.PARAMETER_NOT_SET]
        return known if len(known) == len(parameters) else ()

    def await_recorder(self) -> None:
        """Wait for the last service that the recorder announces: then its readers are known too."""
        self.await_service(self.client(SetBool, _RECORD))

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
        return self.begin_identify(request)()

    def begin_identify(self, request: Identify.Request) -> Callable[[], Identify.Response]:
        """Call the identification service; the result waits for its answer, as `identify` does."""
        answered = self.begin(Identify, "identify", request, _IDENTIFY_S)

        def identified() -> Identify.Response:
            response: Identify.Response = answered()
            if not response.success:
                raise LaunchError(f"identify: {response.message}")
            return response

        return identified

    def start_sampling(self, samples: int = 0) -> None:
        """Activate the DAQ node, which waits for a commander; 0 samples are an endless run."""
        self.set_parameters("daq", {"samples": samples, "await_commander": True})
        self.activate("daq")

    def sample(self, samples: int, progress: Callable[[int], None]) -> Run:
        """Sample a number of periods and wait until the DAQ node has stopped by itself.

        Raises
        ------
        LaunchError
            When hardly a new sample comes for a long time, the DAQ node ends too early, or the
            recorder has failed.
        HeldDriveError
            When the drive is held at zero, or the loop has failed; the run ends early.
        """
        with self._watch as watch:
            self.start_sampling(samples)
            self._await_samples(samples, progress)
            self._require_driving()
            patience = Patience(SERVICE_S)
            while self.is_active("daq"):
                if patience.is_over:
                    raise LaunchError("daq did not stop after its last sample")
            progress(samples)
            self.wait(watch.has_reported, "the figures of the run")
            self._require_driving()
            run = watch.run()
            if run.taken + run.missed < samples:
                raise LaunchError(
                    f"daq ended after {run.taken} of {samples} samples{self._why('daq')}"
                )
            return run

    def recorded_run(
        self, commander: str, bag: str, samples: int, progress: Callable[[int], None]
    ) -> Run:
        """Record one run of the loop into a new bag.

        The commander is active for this run alone: deactivated, it has sent everything.

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

    def _await_samples(self, samples: int, progress: Callable[[int], None]) -> None:
        """Wait for the last sample, or until the DAQ node has stopped before."""
        watch = self._watch
        watch.restart_clock()
        asked, asked_s = 0, time.monotonic()
        while (newest := watch.sequence) < samples and not watch.trouble:
            progress(newest)
            self.spin()
            if time.monotonic() - asked_s > _COMPLAINTS_S:
                if complaint := self._complaint("recorder"):
                    raise LaunchError(f"recorder: {complaint}")
                if newest == asked and not self.is_active("daq"):
                    return
                asked, asked_s = newest, time.monotonic()
            if stall := watch.stall():
                raise LaunchError(stall)

    def _require_driving(self) -> None:
        """End the run when the DAQ node has reported trouble."""
        trouble = self._watch.trouble
        if not trouble:
            return
        # Deactivated, it has sent everything; after a failure it may be on its way there by itself.
        if self.is_active("daq"):
            self.transition("daq", Transition.TRANSITION_DEACTIVATE)
        raise HeldDriveError(f"daq: {trouble}")

    def _why(self, name: str) -> str:
        complaint = self._complaint(name)
        return f": {complaint}" if complaint else ""

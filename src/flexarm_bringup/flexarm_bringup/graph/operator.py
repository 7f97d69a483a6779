"""Operator of the graph, its session, and runs that it watches."""

from __future__ import annotations

import os
import signal
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters, ListParameters, SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from std_srvs.srv import SetBool

from flexarm_bringup.console import interruption
from flexarm_bringup.graph.client import SERVICE_S, ServiceClient
from flexarm_bringup.graph.figures import Run
from flexarm_bringup.graph.processes import NAMESPACE, HeldDriveError, LaunchError
from flexarm_core.bounds import shown
from flexarm_core.clock import Patience
from flexarm_core.errors import nearest
from flexarm_msgs.msg import ArmState, IoSample
from flexarm_msgs.srv import Identify, SetReference
from flexarm_node import qos
from flexarm_node.loop_node import ENDED
from flexarm_node.process import bounded_end
from flexarm_node.stamps import stamp_ns, stamp_text
from flexarm_node.topics.waiting import RawTopicsWaiter
from flexarm_node.transport import set_up_middleware

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from rcl_interfaces.msg import ParameterValue
    from rclpy.node import Node

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
OPERATOR, REMOTE = "operator", "remote"
"""Nodes of the verbs that start nodes, and of those in another terminal.

With SROS2 all have the enclave of the first: who has its keys may operate the arm.
"""

# Ports of later ones are beyond 65535.
_LAST_DOMAIN = 232
STALLED_S = 30.0
"""A run with hardly a new sample in this time has stalled."""
_SLOWEST = 10
"""So many samples come within that time however slow the run; in virtual time one whose answer does
not come may take a third of it."""


_SAMPLES = (("state", ArmState), ("io", IoSample))
"""Topics of samples, of which a rig has one, and their types."""


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


@contextmanager
def session(
    name: str,
    check: Callable[[], None] = lambda: None,
    complaint: Callable[[str], str] = lambda _: "",
    *,
    namespace: str = NAMESPACE,
) -> Iterator[Operator]:
    """Join the graph of an arm as a node of this name and yield its operator; see `Operator`."""
    with interruptible():
        ros_domain()
        set_up_middleware()
        enclave = f"{namespace.rstrip('/')}/{OPERATOR}"
        # Signals stay Python's.
        rclpy.init(
            args=["--ros-args", "--enclave", enclave],
            signal_handler_options=SignalHandlerOptions.NO,
        )
        try:
            node = rclpy.create_node(name, namespace=namespace)
            executor = SingleThreadedExecutor()
            executor.add_node(node)
            yield Operator(node, executor, check, complaint)
        finally:
            with bounded_end():
                try_shutdown()


@contextmanager
def interruptible() -> Iterator[None]:
    """Leave the block by a KeyboardInterrupt at SIGINT, SIGTERM or the end of the terminal.

    A binding in C++ that calls Python may report one as an error of its own, such as "Unable to
    convert call argument". The failure of a node, a `LaunchError`, is reported all the same.
    """
    # `nohup` has it ignored.
    hangs_up = signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN
    with interruption.interruptible(signal.SIGINT, signal.SIGTERM, *[signal.SIGHUP] * hangs_up):
        try:
            yield
        except LaunchError:
            raise
        except Exception as error:
            if interruption.is_interrupted():
                raise KeyboardInterrupt from error
            raise


def ros_domain() -> str:
    """Return the ROS domain of this process.

    Raises
    ------
    LaunchError
        If the environment has none that the middleware has ports for.
    """
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not (text.isdecimal() and int(text[:9]) <= _LAST_DOMAIN):
        raise LaunchError(
            f"ROS_DOMAIN_ID = {shown(text)}: must be a whole number of 0 to {_LAST_DOMAIN}"
        )
    return text


class RunWatch:
    """Watch of one run of the DAQ node at a time.

    It looks at the newest sample when it is asked. An executor would call for every one of them,
    and take as much of the processor as the law.

    Parameters
    ----------
    node : Node
        Node for the readers, in the namespace of the arm; whoever waits spins it.

    Attributes
    ----------
    trouble : str
        What holds the drive at zero or has ended the run, and when, as the node reports it; ""
        while all is well.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._reporter = f"{node.get_namespace().rstrip('/')}/daq"
        self.trouble = ""
        self._states: RawTopicsWaiter | None = None
        self._newest = 0
        self._sampled_s = ""
        self._figures: dict[str, str] | None = None
        self._counted = 0
        self._patience = Patience(STALLED_S)

    def __enter__(self) -> RunWatch:  # noqa: PYI034 - Self needs Python 3.11
        self.trouble = ""
        self.listen()
        self._figures = {}
        topics = [(kind, name, qos.NEWEST) for name, kind in _SAMPLES]
        self._states = RawTopicsWaiter(self._node, topics)
        return self

    def __exit__(self, *_: object) -> None:
        if self._states is not None:
            self._states.close()
            self._states = None
        self._newest = 0

    def listen(self) -> None:
        """Hear the reports of the DAQ node from now on; a run does so by itself."""
        if self._figures is None:
            self._figures = {}
            topic = "/diagnostics"
            self._node.create_subscription(DiagnosticArray, topic, self._on_report, qos.EVERY)

    @property
    def has_ended(self) -> bool:
        """Whether the loop has ended by a failure, which is the trouble then."""
        return self.trouble.startswith(ENDED)

    @property
    def sequence(self) -> int:
        """Number of the newest sample of the run; 0 before the first and between runs."""
        waiting = [] if self._states is None else self._states.wait(0.0)
        if waiting:
            _, kind = _SAMPLES[waiting[-1].topic]
            sample = deserialize_message(waiting[-1].raw, kind)
            self._newest = sample.sequence
            self._sampled_s = stamp_text(stamp_ns(sample.header.stamp))
        return self._newest

    def restart_clock(self) -> None:
        """Count stalls from now on."""
        self._counted, self._patience = 0, Patience(STALLED_S)

    def stall(self) -> str:
        """Return a stall of the run in words, or nothing."""
        newest = self.sequence
        if newest >= self._counted + _SLOWEST:
            self._counted, self._patience = newest, Patience(STALLED_S)
        if not self._patience.is_over:
            return ""
        new = newest - self._counted
        return f"{new} new samples in {self._patience.waited_s:.0f} s after {self._counted}"

    def has_reported(self) -> bool:
        """Return whether the newest figures are those of the run's last sample."""
        figures = self._figures or {}
        # The last sample may have come since the last look.
        is_newest = self.sequence > 0 and figures.get("last sample s") == self._sampled_s
        return is_newest and figures["drive"] == "off"

    def run(self) -> Run:
        """Return the figures of the run, once they have been reported."""
        figures = self._figures or {}
        return Run(
            int(figures["samples"]),
            int(figures["missed periods"]),
            float(figures["real-time factor"]),
            off_rate=figures["off rate"],
            reply_s=1e-3 * float(figures["reply p50 ms"]),
        )

    def _on_report(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._reporter:
                self._figures = {each.key: each.value for each in status.values}
                self.trouble = trouble_in(status) or self.trouble


def trouble_in(status: DiagnosticStatus) -> str:
    """Return what holds the drive or has ended its run by a report, and when; "" without it."""
    if status.level != DiagnosticStatus.ERROR:
        return ""
    trouble = str(status.message).partition(": ")[2]
    after_s = next((each.value for each in status.values if each.key == "held after s"), "")
    return f"{trouble}, after {after_s} s of the run" if after_s else trouble

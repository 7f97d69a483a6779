"""Client of a running arm as a node of its graph, and the stop of every arm that is found there."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import State
from rcl_interfaces.srv import DescribeParameters, ListParameters
from std_srvs.srv import Trigger

from flexarm_bringup.graph.assignments import assigned
from flexarm_bringup.graph.figures import SetPoint
from flexarm_bringup.graph.operator import REMOTE, ros_domain, session
from flexarm_bringup.graph.processes import LaunchError
from flexarm_core.errors import nearest_node
from flexarm_live.graph.node_parameters import own_names, shown
from flexarm_node import qos

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from rclpy.task import Future

    from flexarm_bringup.graph.operator import Operator

# A discovery that misses the first announcements hears the next ones after 3 s.
_DISCOVERY_S = 4.0
_ANSWER_S = 4.0
_DIAGNOSTICS = "/diagnostics"
_REPORTING = {"recorder", "controller", "daq"}
"""Nodes of a laboratory: with their reports, nothing more has to be waited for."""
_STOP = "emergency_stop"


@contextmanager
def graph_client(namespace: str) -> Iterator[GraphClient]:
    """Join the graph of an arm."""
    with session(REMOTE, namespace=namespace) as operator:
        yield GraphClient(operator)


class GraphClient:
    """Client of the arm of an operator; the methods are those of `SocketClient`."""

    def __init__(self, operator: Operator) -> None:
        self._operator = operator

    def stop(self) -> str:
        """Hold the drive at zero until the DAQ node is deactivated; return what it says."""
        self._find("daq")
        return str(self._operator.call(Trigger, _STOP, Trigger.Request()).message)

    def page(self) -> str:
        """Return nothing: a page gives its address on its socket."""
        return ""

    def reports(self) -> Mapping[str, tuple[str, Mapping[str, str]]]:
        """Return the message and the figures of each node that reports."""
        operator = self._operator
        newest: dict[str, DiagnosticStatus] = {}
        ours = operator.full_name("")

        def hear(message: DiagnosticArray) -> None:
            for report in message.status:
                if report.name.startswith(ours):
                    newest[report.name.removeprefix(ours)] = report

        def complete() -> bool:
            publishers = operator.node.get_publishers_info_by_topic(_DIAGNOSTICS)
            known = [each for each in publishers if each.node_namespace == operator.namespace]
            return newest.keys() >= _REPORTING and len(newest) >= len(known)

        operator.listen(DiagnosticArray, _DIAGNOSTICS, qos.EVERY, hear)
        try:
            operator.wait(complete, "reports", _DISCOVERY_S)
        except LaunchError:
            if not newest:
                raise LaunchError(self._no_arm("node that reports")) from None
        return {
            name: (report.message, {each.key: each.value for each in report.values})
            for name, report in newest.items()
        }

    def reference(self, value: float, joint: str = "") -> SetPoint:
        """Give the controller a set-point; return the one in force."""
        self._find("controller")
        response = self._operator.set_reference(value, joint)
        return SetPoint(float(response.reference_v), str(response.message))

    def parameters(self, node: str) -> Mapping[str, Sequence[Mapping[str, Any]]]:
        """Return the parameters of a node, or of every one, with values, bounds and units."""
        if node:
            self._find(node)
        return {each: self._described(each) for each in ([node] if node else self._reporting())}

    def _reporting(self) -> list[str]:
        operator = self._operator
        ours = {operator.full_name(name): name for name in sorted(_REPORTING | {"ident"})}
        try:
            operator.wait(lambda: operator.nodes() >= ours.keys(), "the nodes", _DISCOVERY_S)
        except LaunchError:
            if not operator.nodes() & ours.keys():
                raise LaunchError(self._no_arm("node with parameters")) from None
        return [name for full, name in ours.items() if full in operator.nodes()]

    def _described(self, node: str) -> list[dict[str, Any]]:
        call = self._operator.call
        listed = call(ListParameters, f"{node}/list_parameters", ListParameters.Request())
        names = own_names(listed.result.names)
        described = call(
            DescribeParameters,
            f"{node}/describe_parameters",
            DescribeParameters.Request(names=names),
        )
        values = self._operator.values(node, tuple(names))
        return [shown(each, values[each.name]) for each in described.descriptors]

    def set(self, node: str, values: Mapping[str, Any]) -> Mapping[str, tuple[Any, Any]]:
        """Set parameters of a node, all or none; return the former and the new values."""
        self._find(node)
        before = self._operator.values(node, tuple(values))
        changes = assigned(node, values, before)
        self._operator.set_parameters(node, changes)
        return {name: (before[name], value) for name, value in changes.items()}

    def activate(self, node: str) -> str:
        """Activate a managed node and return its state."""
        self._find(node)
        operator = self._operator
        before = operator.state(node).id
        if before == State.PRIMARY_STATE_ACTIVE:
            raise LaunchError(
                f"{node} is active already; what holds it ends with: deactivate {node}"
            )
        if before == State.PRIMARY_STATE_UNCONFIGURED:
            operator.configure(node)
        operator.activate(node)
        return str(operator.state(node).label)

    def deactivate(self, node: str) -> str:
        """Deactivate a managed node and return its state."""
        self._find(node)
        before = self._operator.state(node)
        if before.id != State.PRIMARY_STATE_ACTIVE:
            raise LaunchError(f"{node} is not active but {before.label}")
        self._operator.deactivate(node)
        return str(self._operator.state(node).label)

    def _no_arm(self, wanted: str) -> str:
        """Return that nothing of this arm was heard of, and which arms were."""
        nodes = (each.rpartition("/") for each in self._operator.nodes())
        arms = sorted({space for space, _, name in nodes if name in _REPORTING})
        if not arms:
            return _nobody(wanted)
        options = " or ".join(f"--namespace {arm.strip('/')}" for arm in arms)
        heard = f"{_where()} in {self._operator.namespace}, but {', '.join(arms)} was"
        return f"no {wanted} {heard}: give {options}"

    def _find(self, name: str) -> None:
        """Wait until a node is discovered."""
        operator = self._operator
        wanted = operator.full_name(name)
        try:
            operator.wait(lambda: wanted in operator.nodes(), wanted, _DISCOVERY_S)
        except LaunchError:
            others = operator.nodes() - {operator.full_name(REMOTE)}
            # Beside them there may be nodes of the user's own.
            if others & {operator.full_name(each) for each in _REPORTING}:
                raise LaunchError(_nobody(f"node {wanted}", nearest_node(wanted, others))) from None
            raise LaunchError(self._no_arm(f"node {wanted}")) from None


def stop_arms_of_graph(stopped_already: Collection[str]) -> Iterator[tuple[str, str]]:
    """Stop each arm as soon as it is found, and look for others as long as discovery may take.

    Parameters
    ----------
    stopped_already : collection of str
        Namespaces of arms that need no stop any more.

    Yields
    ------
    tuple of str
        Namespace of an arm, and what its DAQ node says.

    Raises
    ------
    LaunchError
        When there is none at all, or one does not answer.
    """
    asked: dict[str, list[Future[Any]]] = {}
    stopped = {f"{arm}/{_STOP}" for arm in stopped_already}
    with session(REMOTE) as operator:
        begun_s = time.monotonic()

        def may_come() -> bool:
            passed_s = time.monotonic() - begun_s
            patience_s = _ANSWER_S if asked.keys() - stopped else 0.0
            return passed_s < _DISCOVERY_S + patience_s

        while may_come():
            for service in _stops(operator) - stopped:
                # Until it answers: the first answers may be lost, a stop can be repeated.
                call = operator.client(Trigger, service).call_async(Trigger.Request())
                asked.setdefault(service, []).append(call)
            operator.spin()
            for service, calls in asked.items():
                answers = [call.result() for call in calls if call.done()]
                if answers and service not in stopped:
                    stopped.add(service)
                    yield service.removesuffix(f"/{_STOP}"), answers[0].message
    if silent := sorted(asked.keys() - stopped):
        raise LaunchError(f"no answer from {', '.join(silent)}: press the button at the rig")
    if not stopped:
        raise LaunchError(_nobody("arm"))


def _stops(operator: Operator) -> set[str]:
    """Return the emergency stops of the arms that are there."""
    topics = operator.node.get_topic_names_and_types()
    arms = {
        topic.rpartition("/")[0]
        for topic, kinds in topics
        if any(kind.startswith("flexarm_msgs/") for kind in kinds)
    }
    services = {service for service, _ in operator.node.get_service_names_and_types()}
    return {f"{arm}/{_STOP}" for arm in arms} & services


def _nobody(wanted: str, others: str = "") -> str:
    return (
        f"no {wanted} {_where()}{others}: "
        "start an arm with flexarm up, or use its ROS_DOMAIN_ID and --namespace"
    )


def _where() -> str:
    return f"was found in ROS domain {ros_domain()} within {_DISCOVERY_S:.0f} s"

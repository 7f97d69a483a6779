"""Verbs that operate a running graph from another terminal."""

from __future__ import annotations

import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import click
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import State
from std_srvs.srv import Trigger

from flexarm_bringup.console import terminal
from flexarm_bringup.console.quantity import POSITION_V, Quantity
from flexarm_bringup.console.verb_group import examples
from flexarm_bringup.graph.laboratory import MANAGED
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.graph.session import REMOTE, ros_domain, session
from flexarm_bringup.verbs.laboratory.options import ARM
from flexarm_core.bounds import YamlError, shown, yaml_content
from flexarm_core.nearest import nearest
from flexarm_msgs.srv import SetReference
from flexarm_node import qos

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.task import Future

    from flexarm_bringup.graph.operator import Operator

# A discovery that misses the first announcements hears the next ones after 3 s.
_DISCOVERY_S = 4.0
_ANSWER_S = 4.0
_DIAGNOSTICS = "/diagnostics"
_REPORTING = {"recorder", "controller", "daq"}
"""Nodes of a laboratory: with their reports, nothing more has to be waited for."""
_STOP = "emergency_stop"


@click.command()
@ARM
@click.option("--all", "everything", is_flag=True, help="Every arm that is found.")
@examples("stop", "stop --namespace arm2", "stop --all")
def stop(*, namespace: str, everything: bool) -> None:
    """Stop the drive until the DAQ node is deactivated.

    It takes seconds to start: at a real rig, press the button.
    """
    if everything:
        _stop_every_arm()
        return
    with _attached("daq", namespace) as operator:
        response = operator.call(Trigger, _STOP, Trigger.Request())
    terminal.CONSOLE.print(response.message, markup=False)


def _stop_every_arm() -> None:
    """Stop each arm as soon as it is found, and look for others as long as discovery may take."""
    asked: dict[str, list[Future[Any]]] = {}
    stopped: set[str] = set()
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
                    arm = service.removesuffix(f"/{_STOP}")
                    terminal.CONSOLE.print(f"{arm}: {answers[0].message}", markup=False)
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


@click.command()
@ARM
@examples("status", "status --namespace arm2")
def status(namespace: str) -> None:
    """Show state, reasons, rates and counts of every running node."""
    newest: dict[str, DiagnosticStatus] = {}
    ours = f"{namespace.rstrip('/')}/"

    def hear(message: DiagnosticArray) -> None:
        for report in message.status:
            if report.name.startswith(ours):
                newest[report.name.removeprefix(ours)] = report

    with session(REMOTE, namespace=namespace) as operator:
        operator.listen(DiagnosticArray, _DIAGNOSTICS, qos.EVERY, hear)

        def complete() -> bool:
            publishers = operator.node.get_publishers_info_by_topic(_DIAGNOSTICS)
            known = [each for each in publishers if each.node_namespace == namespace]
            return newest.keys() >= _REPORTING and len(newest) >= len(known)

        try:
            operator.wait(complete, "reports", _DISCOVERY_S)
        except LaunchError:
            if not newest:
                raise LaunchError(_nobody("node that reports")) from None
    for name, report in sorted(newest.items()):
        terminal.CONSOLE.print(f"{name}: {report.message}", markup=False)
        for each in report.values:
            terminal.CONSOLE.print(f"    {each.key:36s} {each.value}", markup=False)


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("set_point_v", metavar="SET_POINT", type=Quantity(POSITION_V))
@ARM
@examples("reference 1.5", "reference -3", "reference 23deg")
def reference(set_point_v: float, namespace: str) -> None:
    """Give the running controller a set-point.

    It is in V, or has its unit: deg, rad. What is in force is printed.
    """
    with _attached("controller", namespace) as operator:
        request = SetReference.Request(reference_v=set_point_v)
        response = operator.call(SetReference, "set_reference", request)
    if not response.success:
        raise LaunchError(response.message)
    terminal.CONSOLE.print(f"set-point {response.reference_v:g} V")


@click.command("set")
@click.argument("node")
@click.argument("assignments", nargs=-1, required=True, metavar="NAME=VALUE...")
@ARM
@examples("set controller law=pdpc_plus", "set daq max_command_v=2 payload_kg=0.2")
def set_(node: str, assignments: tuple[str, ...], namespace: str) -> None:
    """Set parameters of a running node, all or none."""
    wanted = dict(_parsed(each) for each in assignments)
    with _attached(node, namespace) as operator:
        present = operator.values(node, tuple(wanted))
        changes = {key: _as_kind(value, present[key]) for key, value in wanted.items()}
        operator.set_parameters(node, changes)
    for key, value in changes.items():
        terminal.CONSOLE.print(f"{node} {key}: {present[key]} -> {value}", markup=False)


@click.command()
@click.argument("node", type=click.Choice(MANAGED))
@ARM
@examples("activate daq")
def activate(node: str, namespace: str) -> None:
    """Activate a running node: daq, controller or experiment."""
    with _attached(node, namespace) as operator:
        before = operator.state(node).id
        if before == State.PRIMARY_STATE_ACTIVE:
            raise LaunchError(
                f"{node} is active already; what holds it ends with: deactivate {node}"
            )
        if before == State.PRIMARY_STATE_UNCONFIGURED:
            operator.configure(node)
        operator.activate(node)
        state = operator.state(node).label
    terminal.CONSOLE.print(f"{node} is {state}", markup=False)


@click.command()
@click.argument("node", type=click.Choice(MANAGED))
@ARM
@examples("deactivate daq")
def deactivate(node: str, namespace: str) -> None:
    """Deactivate a running node; the drive goes to zero."""
    with _attached(node, namespace) as operator:
        before = operator.state(node)
        if before.id != State.PRIMARY_STATE_ACTIVE:
            raise LaunchError(f"{node} is not active but {before.label}")
        operator.deactivate(node)
        state = operator.state(node).label
    terminal.CONSOLE.print(f"{node} is {state}", markup=False)


@contextmanager
def _attached(name: str, namespace: str) -> Iterator[Operator]:
    """Give an operator of an arm of which a node is running."""
    with session(REMOTE, namespace=namespace) as operator:
        wanted = operator.full_name(name)
        try:
            operator.wait(lambda: wanted in operator.nodes(), wanted, _DISCOVERY_S)
        except LaunchError:
            others = operator.nodes() - {operator.full_name(REMOTE)}
            raise LaunchError(_nobody(f"node {wanted}") + nearest(wanted, others)) from None
        yield operator


def _nobody(wanted: str) -> str:
    return f"no {wanted} was heard of in ROS domain {ros_domain()} within {_DISCOVERY_S:.0f} s"


def _parsed(assignment: str) -> tuple[str, Any]:
    name, sign, text = assignment.partition("=")
    if not (name and sign):
        raise LaunchError(f"{shown(assignment)}: write NAME=VALUE")
    try:
        return name, yaml_content(text)
    except YamlError:
        raise LaunchError(f"{shown(assignment)}: the value is none") from None


def _as_kind(value: object, present: object) -> object:
    """Take a number for a float where a float is wanted: 2 and 2e0, a text in YAML, for 2.0."""
    if isinstance(present, float) and isinstance(value, (int, str)) and not isinstance(value, bool):
        with suppress(ValueError):
            return float(value)
    return value

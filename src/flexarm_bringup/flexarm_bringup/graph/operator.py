"""A graph that is running already, operated from another terminal."""

from __future__ import annotations

from collections import Counter
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import State
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from flexarm_bringup.console import terminal
from flexarm_bringup.graph.interruption import interruptible
from flexarm_bringup.graph.laboratory import initialised, ros_domain
from flexarm_bringup.graph.operation import NAMESPACE, Operator
from flexarm_bringup.graph.processes import LaunchError
from flexarm_core.channels import TRAVEL_V
from flexarm_node import qos
from flexarm_node.waiting import has_every_reader

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rclpy.node import Node

# A discovery that misses the first announcements hears the next ones after 3 s.
_DISCOVERY_S = 7.0
_ACKNOWLEDGED = Duration(seconds=3)
_DIAGNOSTICS = "/diagnostics"
_OURS = "flexarm: "
# Each node reports once a second, and one whose first announcement was missed is heard of after
# 3 s: when one has reported so often, all have.
_REPORTS = 5


def emergency_stop() -> None:
    """Take the drive to zero until the DAQ node is activated anew.

    Raises
    ------
    LaunchError
        When no DAQ node is there, or it does not answer.
    """
    with _attached("daq") as (operator, _):
        response = operator.call(Trigger, "emergency_stop", Trigger.Request())
    terminal.CONSOLE.print(response.message, markup=False)


def show_status() -> None:
    """Print what every node of the graph reports of itself on `/diagnostics`.

    Raises
    ------
    LaunchError
        When none reports.
    """
    newest: dict[str, DiagnosticStatus] = {}
    reports: Counter[str] = Counter()

    def hear(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.startswith(_OURS):
                newest[status.name] = status
                reports[status.name] += 1

    with _operator() as (operator, node):
        operator.listen(DiagnosticArray, _DIAGNOSTICS, qos.EVERY, hear)

        def complete() -> bool:
            all_known = len(newest) >= node.count_publishers(_DIAGNOSTICS)
            return all_known and max(reports.values(), default=0) >= _REPORTS

        try:
            operator.wait(complete, "reports", _DISCOVERY_S)
        except LaunchError:
            if not newest:
                raise LaunchError(f"no node reports in ROS domain {ros_domain()}") from None
    for name, status in sorted(newest.items()):
        terminal.CONSOLE.print(f"{name.removeprefix(_OURS)}: {status.message}", markup=False)
        for each in status.values:
            terminal.CONSOLE.print(f"    {each.key:36s} {each.value}", markup=False)


def set_reference(reference_v: float) -> None:
    """Publish one set-point for the controller.

    Raises
    ------
    LaunchError
        When it is beyond the travel, no controller is there, or that has a reference of its own.
    """
    if not abs(reference_v) <= TRAVEL_V:
        raise LaunchError(f"{reference_v:g} V is beyond the travel, +-{TRAVEL_V:.3f} V")
    with _attached("controller") as (operator, node):
        source = operator.values("controller", ("reference",))["reference"]
        if source != "topic":
            raise LaunchError(
                f"the controller follows its own reference, {source}: "
                "flexarm set controller reference=topic"
            )
        publisher = node.create_publisher(Float64, f"{NAMESPACE}/reference", qos.NEWEST)
        operator.acquaint("controller")
        operator.wait(lambda: has_every_reader(node, [publisher], least=1), "the controller")
        publisher.publish(Float64(data=reference_v))
        publisher.wait_for_all_acked(_ACKNOWLEDGED)
    terminal.CONSOLE.print(f"set-point {reference_v:g} V")


def set_parameters(name: str, assignments: Sequence[str]) -> None:
    """Set parameters of a running node, all or none.

    Parameters
    ----------
    name
        Node below the namespace, such as `controller`.
    assignments
        Each as NAME=VALUE.

    Raises
    ------
    LaunchError
        When one cannot be understood, is unknown or is refused; the node's own words then.
    """
    wanted = dict(_parsed(each) for each in assignments)
    with _attached(name) as (operator, _):
        present = operator.values(name, tuple(wanted))
        changes = {key: _as_kind(value, present[key]) for key, value in wanted.items()}
        operator.set_parameters(name, changes)
    for key, value in changes.items():
        terminal.CONSOLE.print(f"{name} {key}: {present[key]} -> {value}", markup=False)


def change_state(name: str, *, active: bool) -> None:
    """Activate a managed node, configuring it if need be, or deactivate it.

    Raises
    ------
    LaunchError
        When it is not there, is in that state already, or refuses.
    """
    with _attached(name) as (operator, _):
        before = operator.state(name)
        if active and before.id == State.PRIMARY_STATE_ACTIVE:
            raise LaunchError(
                f"{name} is active already; what holds it ends with: deactivate {name}"
            )
        if not active and before.id != State.PRIMARY_STATE_ACTIVE:
            raise LaunchError(f"{name} is not active but {before.label}")
        if not active:
            operator.deactivate(name)
        else:
            if before.id == State.PRIMARY_STATE_UNCONFIGURED:
                operator.configure(name)
            operator.activate(name)
        state = operator.state(name).label
    terminal.CONSOLE.print(f"{name} is {state}", markup=False)


@contextmanager
def _operator() -> Iterator[tuple[Operator, Node]]:
    with interruptible(), initialised():
        node = rclpy.create_node("remote", namespace=NAMESPACE)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        yield Operator(node, executor, lambda: None), node


@contextmanager
def _attached(name: str) -> Iterator[tuple[Operator, Node]]:
    with _operator() as (operator, node):
        wanted = f"{NAMESPACE}/{name}"
        try:
            operator.wait(lambda: wanted in operator.nodes(), wanted, _DISCOVERY_S)
        except LaunchError:
            raise LaunchError(f"no node {wanted} in ROS domain {ros_domain()}") from None
        yield operator, node


def _parsed(assignment: str) -> tuple[str, Any]:
    name, sign, text = assignment.partition("=")
    if not (name and sign):
        raise LaunchError(f"{assignment!r}: write NAME=VALUE")
    try:
        return name, yaml.safe_load(text)
    except yaml.YAMLError:
        raise LaunchError(f"{assignment!r}: the value is none") from None


def _as_kind(value: object, present: object) -> object:
    """Take a whole number for a float where a float is wanted: 2 for 2.0."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    return float(value) if whole and isinstance(present, float) else value  # type: ignore[arg-type]

"""Graph of the laboratory: its nodes as processes, in a domain of their own."""

from __future__ import annotations

import os
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from flexarm_bringup.console import terminal
from flexarm_bringup.graph.operator import OPERATOR, interruptible, ros_domain, session
from flexarm_bringup.graph.processes import (
    MANAGED,
    NAMESPACE,
    LaunchError,
    NodeProcesses,
    NodeProgram,
)
from flexarm_core.own_files import claimed, private_folder
from flexarm_node.parameter_files import (
    LOOP,
    NODE_NAMES,
    is_simulated,
    unknown_nodes,
    unreadable,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from flexarm_bringup.graph.operator import Operator

_DISCOVERY_S = 0.7
_NODES = {
    "recorder": ("flexarm_daq", "recorder_node"),
    "ident": ("flexarm_ident", "ident_node"),
    "controller": ("flexarm_control", "controller_node"),
    "experiment": ("flexarm_daq", "experiment_node"),
    "daq": ("flexarm_daq", "daq_node"),
    "live": ("flexarm_live", "live_node"),
    "foxglove": ("flexarm_live", "foxglove_node"),
}
LABORATORY = ("recorder", "ident", "controller", "daq")
"""The nodes of a running laboratory, in the order in which they start."""


# What is changed in a run is in its record: `law` has the law, this the payload and the limits.
_OF_ANY = ["commander", "law", "rig_description", "/parameter_events"]


def recorded_topics(*, is_thesis: bool) -> list[str]:
    """Return the topics that a record of a running arm has, the thesis's or any other one."""
    if is_thesis:
        return [*_OF_ANY, "state", "command", "reference"]
    return [*_OF_ANY, "io", "io_channels", "io_command", "io_reference"]


@contextmanager
def running_graph(
    parameters: Mapping[str, Mapping[str, Any]],
    log: Path,
    *,
    nodes: Sequence[str] = LABORATORY,
    idle: Sequence[str] = (),
    files: tuple[Path, ...] = (),
    namespace: str = NAMESPACE,
    compose: bool | None = None,
) -> Iterator[tuple[Operator, NodeProcesses]]:
    """Start nodes in this order, configure the managed ones, and stop all of them at the end.

    Parameters
    ----------
    parameters : mapping of str to mapping
        Initial parameters by node name.
    log : Path
        File of what the nodes print.
    nodes : sequence of str
        Names of the nodes.
    idle : sequence of str
        Those of them that are not configured: they have no topic, and wait.
    files : tuple of Path
        Parameter files for all of them; a node takes its own section.
    namespace : str
        Namespace of the arm.
    compose : bool, optional
        Run the nodes daq and controller in one process, or in two. By default those of a simulation
        share one; a crash in a law must not take along what writes a board's zero.

    Raises
    ------
    LaunchError
        When another graph of this arm runs in this domain, a file has no parameters, or a node
        does not start.
    """
    known = {f"{namespace.rstrip('/')}/{name}" for name in NODE_NAMES}
    for file in files:
        if wrong := unreadable(file):
            raise LaunchError(wrong)
        for name in unknown_nodes(file, known):
            terminal.CONSOLE.print(f"note: {file} is also for {name}, no node here")
    if compose is None:
        rig = str(parameters.get("daq", {}).get("rig", ""))
        has_both = set(LOOP) <= set(nodes)
        compose = has_both and is_simulated(rig, files, f"{namespace.rstrip('/')}/daq")
    alone = [name for name in nodes if not (compose and name in LOOP)]
    programs = [
        NodeProgram(*_NODES[name], parameters.get(name, {}), files, namespace) for name in alone
    ]
    if compose:
        programs.append(_loop_program(parameters, files, namespace))
    processes = NodeProcesses(programs, log)
    checks = processes.check, processes.complaint
    with (
        claimed_domain(namespace),
        interruptible(),
        processes,
        session(OPERATOR, *checks, namespace=namespace) as operator,
    ):
        _require_free_domain(operator)
        try:
            processes.let_in()
            for name in MANAGED:
                if name in nodes and name not in idle:
                    operator.configure(name)
            if "recorder" in nodes:
                operator.await_recorder()
            yield operator, processes
        finally:
            # Before the operator leaves the graph: it may still be asked what they have said.
            processes.stop()


def _loop_program(
    parameters: Mapping[str, Mapping[str, Any]], files: tuple[Path, ...], namespace: str
) -> NodeProgram:
    own = {
        f"{node}.{name}": value for node in LOOP for name, value in parameters.get(node, {}).items()
    }
    return NodeProgram("flexarm_bringup", "loop_node", own, files, namespace, has_several=True)


@contextmanager
def claimed_domain(namespace: str) -> Iterator[None]:
    """Keep a second graph of this arm out of the domain: discovery may take seconds to see it.

    Graphs of other users and nodes that were started by hand are left to discovery.
    """
    try:
        claim = os.open(
            private_folder() / f"domain_{ros_domain()}{namespace.replace('/', '_')}",
            os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC,
            0o600,
        )
    except OSError as error:
        raise LaunchError(
            f"cannot claim the ROS domain: {error.filename}: {error.strerror}"
        ) from error
    with claimed(claim, LaunchError(_taken("a graph"))):
        yield


def _require_free_domain(operator: Operator) -> None:
    time.sleep(_DISCOVERY_S)
    others = operator.nodes() & {operator.full_name(name) for name in _NODES}
    if others:
        raise LaunchError(_taken(", ".join(sorted(others))))


def _taken(by: str) -> str:
    return (
        f"{by} runs already in ROS domain {ros_domain()}: "
        "stop it, set ROS_DOMAIN_ID to another number, or name another --namespace"
    )

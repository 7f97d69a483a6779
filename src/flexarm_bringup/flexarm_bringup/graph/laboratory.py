"""The graph of the laboratory as processes, and an operator for it."""

from __future__ import annotations

import fcntl
import os
import time
from contextlib import contextmanager
from pathlib import Path
from tempfile import gettempdir
from typing import TYPE_CHECKING

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from flexarm_bringup.console import terminal
from flexarm_bringup.graph.interruption import interruptible
from flexarm_bringup.graph.operation import NAMESPACE, Operator
from flexarm_bringup.graph.parameter_files import unknown_nodes
from flexarm_bringup.graph.processes import LaunchError, NodeProcesses, NodeProgram

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from typing import Any

_DISCOVERY_S = 0.7
_NODES = {
    "recorder": ("flexarm_daq", "recorder_node"),
    "ident": ("flexarm_ident", "ident_node"),
    "controller": ("flexarm_control", "controller_node"),
    "experiment": ("flexarm_daq", "experiment_node"),
    "daq": ("flexarm_daq", "daq_node"),
}
_KNOWN = {f"{NAMESPACE}/{name}" for name in (*_NODES, "tuner", "player")}
_MANAGED = ("daq", "controller", "experiment")
LABORATORY = ("recorder", "ident", "controller", "daq")
"""The nodes of a running laboratory, in the order in which they start."""


@contextmanager
def running_graph(
    parameters: Mapping[str, Mapping[str, Any]],
    log: Path,
    *,
    nodes: Sequence[str] = LABORATORY,
    files: tuple[Path, ...] = (),
) -> Iterator[tuple[Operator, NodeProcesses]]:
    """Start nodes, configure the managed ones, and stop all of them at the end.

    Parameters
    ----------
    parameters
        Parameters to start with, by node name.
    log
        File that gets what the nodes print.
    nodes
        Which ones, in this order.
    files
        Parameter files for all of them; a node takes what is under its name.

    Raises
    ------
    LaunchError
        When another flexarm graph is running in this domain, or a node does not start.
    """
    for file in files:
        for name in unknown_nodes(file, _KNOWN):
            terminal.CONSOLE.print(f"note: {file} is also for {name}, no node here", markup=False)
    with interruptible(), _claimed_domain(), initialised():
        node = rclpy.create_node("operator", namespace=NAMESPACE)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        programs = [NodeProgram(*_NODES[name], parameters.get(name, {}), files) for name in nodes]
        processes = NodeProcesses(programs, log)
        operator = Operator(node, executor, processes.check, processes.complaint)
        _require_free_domain(operator)
        with processes:
            for name in _MANAGED:
                if name in nodes:
                    operator.configure(name)
            if "recorder" in nodes:
                operator.await_recorder()
            yield operator, processes


@contextmanager
def initialised() -> Iterator[None]:
    """Have rclpy for a while; signals stay Python's."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield
    finally:
        try_shutdown()


@contextmanager
def _claimed_domain() -> Iterator[None]:
    """Keep a second graph of this machine out of the domain: discovery may take seconds to see it.

    Graphs of other users and nodes that were started by hand are left to discovery.
    """
    try:
        claim = os.open(
            Path(gettempdir(), f"flexarm_domain_{ros_domain()}"), os.O_RDWR | os.O_CREAT
        )
    except PermissionError:
        yield
        return
    try:
        fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise LaunchError(_taken("a graph")) from None
    else:
        yield
    finally:
        os.close(claim)


def _require_free_domain(operator: Operator) -> None:
    time.sleep(_DISCOVERY_S)
    others = operator.nodes() & {f"{NAMESPACE}/{name}" for name in _NODES}
    if others:
        raise LaunchError(_taken(", ".join(sorted(others))))


def _taken(by: str) -> str:
    return (
        f"{by} runs already in ROS domain {ros_domain()}: "
        "stop it, or set ROS_DOMAIN_ID to another number"
    )


def ros_domain() -> str:
    """Return the ROS domain of this process."""
    return os.environ.get("ROS_DOMAIN_ID", "0")

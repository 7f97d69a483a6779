"""Graph of the laboratory: its nodes as processes, in a domain of their own."""

from __future__ import annotations

import fcntl
import os
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from flexarm_bringup.console import terminal
from flexarm_bringup.graph.client import NAMESPACE
from flexarm_bringup.graph.processes import LaunchError, NodeProcesses, NodeProgram
from flexarm_bringup.graph.session import ros_domain, session
from flexarm_core.bounds import read_text_bytes, yaml_content
from flexarm_core.errors import FlexarmError
from flexarm_core.own_files import private_folder

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence
    from pathlib import Path

    from flexarm_bringup.graph.operator import Operator

_DISCOVERY_S = 0.7
_PARAMETERS = "ros__parameters"
_NODES = {
    "recorder": ("flexarm_daq", "recorder_node"),
    "ident": ("flexarm_ident", "ident_node"),
    "controller": ("flexarm_control", "controller_node"),
    "experiment": ("flexarm_daq", "experiment_node"),
    "daq": ("flexarm_daq", "daq_node"),
}
_KNOWN = {f"{NAMESPACE}/{name}" for name in (*_NODES, "tuner", "player")}
MANAGED = ("daq", "controller", "experiment")
"""The nodes with a lifecycle."""
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
    """Start nodes in this order, configure the managed ones, and stop all of them at the end.

    Parameters
    ----------
    parameters : mapping of str to mapping
        Initial parameters by node name.
    log : Path
        File of what the nodes print.
    nodes : sequence of str
        Names of the nodes.
    files : tuple of Path
        Parameter files for all of them; a node takes its own section.

    Raises
    ------
    LaunchError
        When another flexarm graph runs in this domain, or a node does not start.
    """
    for file in files:
        for name in unknown_nodes(file, _KNOWN):
            terminal.CONSOLE.print(f"note: {file} is also for {name}, no node here", markup=False)
    programs = [NodeProgram(*_NODES[name], parameters.get(name, {}), files) for name in nodes]
    processes = NodeProcesses(programs, log)
    checks = processes.check, processes.complaint
    with claimed_domain(), session("operator", *checks) as operator:
        _require_free_domain(operator)
        with processes:
            for name in MANAGED:
                if name in nodes:
                    operator.configure(name)
            if "recorder" in nodes:
                operator.await_recorder()
            yield operator, processes


def unknown_nodes(file: Path, known: Collection[str]) -> list[str]:
    """Return the unknown nodes in a parameter file of ROS 2; none if it cannot be read."""
    try:
        content = yaml_content(read_text_bytes(file).decode("utf-8"))
    except (OSError, UnicodeDecodeError, FlexarmError):
        return []
    names = _named(content, "") if isinstance(content, dict) else iter(())
    return [name for name in names if "*" not in name and name not in known]


def _named(content: Mapping[str, Any], namespace: str) -> Iterator[str]:
    for key, below in content.items():
        name = f"{namespace}/{str(key).strip('/')}"
        if isinstance(below, dict) and _PARAMETERS in below:
            yield name
        elif isinstance(below, dict):
            yield from _named(below, name)


@contextmanager
def claimed_domain() -> Iterator[None]:
    """Keep a second graph of this machine out of the domain: discovery may take seconds to see it.

    Graphs of other users and nodes that were started by hand are left to discovery.
    """
    try:
        claim = os.open(
            private_folder() / f"domain_{ros_domain()}",
            os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC,
            0o600,
        )
    except OSError as error:
        raise LaunchError(
            f"cannot claim the ROS domain: {error.filename}: {error.strerror}"
        ) from error
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

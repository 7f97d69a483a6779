"""Nodes whose end is not that of a running laboratory: told, with the command of another one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_bringup.console import terminal
from flexarm_bringup.console.called import as_called
from flexarm_bringup.graph.processes import LaunchError

if TYPE_CHECKING:
    from collections.abc import Callable

    from flexarm_bringup.graph.processes import NodeProcesses

_CONTROLLER = "controller_node"
_BESIDE = {
    "recorder_node": ("flexarm_daq", "nothing is recorded any more, and the arm goes on"),
    "experiment_node": ("flexarm_daq", "the arm goes on without experiments in open loop"),
    "ident_node": ("flexarm_ident", "the arm goes on without identification"),
}
"""Nodes that no loop needs and that may be started by hand: their packages, and what is lost."""
_OF_UP = "the arm goes on without it; to have it back, end this up by Ctrl-C and start it again"


class LostNodes:
    """Nodes that have ended while the laboratory goes on.

    Parameters
    ----------
    processes : NodeProcesses
        Nodes of the laboratory.
    namespace : str
        Namespace of the arm.
    controller : callable
        Returns the arguments of another controller in the place of the first, as ROS 2 takes them.
    """

    def __init__(
        self, processes: NodeProcesses, namespace: str, controller: Callable[[], str]
    ) -> None:
        self._processes = processes
        self._namespace = namespace
        self._controller = controller
        self._told: set[str] = set()
        for executable in (_CONTROLLER, *_BESIDE):
            processes.let_be_replaced(executable)

    def look(self) -> None:
        """Tell the end of each node, once, and how another one takes its place."""
        for executable, ending in self._processes.losses().items():
            if executable not in self._told:
                self._told.add(executable)
                terminal.CONSOLE.print(as_called(f"{ending}; {self._consequence(executable)}"))

    def check(self) -> None:
        """Raise a `LaunchError` with the ends of the nodes, if there were any."""
        if losses := self._processes.losses():
            raise LaunchError("; ".join(losses.values()))

    def _consequence(self, executable: str) -> str:
        if executable == _CONTROLLER:
            another = self._another("flexarm_control", executable)
            return f"the drive is at zero; {another} {self._controller()}"
        if executable not in _BESIDE:
            return _OF_UP
        package, consequence = _BESIDE[executable]
        return f"{consequence}; {self._another(package, executable)}"

    def _another(self, package: str, executable: str) -> str:
        line = f"flexarm run {package} {executable} --ros-args -r __ns:={self._namespace}"
        return f"for another one: {line}"

"""Nodes whose end does not end a laboratory: reported, with the command of another one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_bringup.console import terminal
from flexarm_bringup.console.called import as_called
from flexarm_bringup.graph.processes import LaunchError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flexarm_bringup.graph.processes import NodeProcesses

_WITHOUT = {
    "controller_node": ("flexarm_control", "the drive goes to zero"),
    "recorder_node": ("flexarm_daq", "nothing is recorded any more, and the arm goes on"),
    "experiment_node": ("flexarm_daq", "the arm goes on without experiments in open loop"),
    "ident_node": ("flexarm_ident", "the arm goes on without identification"),
}
"""Nodes that may be started by hand: their packages, and what the laboratory is without them."""
_OF_UP = "the arm goes on without it; to have it back, end this up by Ctrl-C and start it again"


class LostNodes:
    """Nodes that have ended while the laboratory goes on.

    Parameters
    ----------
    processes : NodeProcesses
        Nodes of the laboratory.
    namespace : str
        Namespace of the arm.
    words : mapping of str to callable
        Functions that return the arguments of another node in the place of the first, as ROS 2
        takes them, by the name of its executable.
    """

    def __init__(
        self, processes: NodeProcesses, namespace: str, words: Mapping[str, Callable[[], str]]
    ) -> None:
        self._processes = processes
        self._namespace = namespace
        self._words = words
        self._reported: set[str] = set()
        for executable in _WITHOUT:
            processes.let_be_replaced(executable)

    def look(self) -> None:
        """Tell the end of each node, once, and how another one takes its place."""
        for executable, ending in self._processes.losses().items():
            if executable not in self._reported:
                self._reported.add(executable)
                terminal.CONSOLE.print(as_called(f"{ending}; {self._consequence(executable)}"))

    def check(self) -> None:
        """Raise a `LaunchError` with the ends of the nodes, if there were any."""
        if losses := self._processes.losses():
            raise LaunchError("; ".join(losses.values()))

    def _consequence(self, executable: str) -> str:
        if executable not in _WITHOUT:
            return _OF_UP
        package, consequence = _WITHOUT[executable]
        line = f"flexarm run {package} {executable} --ros-args -r __ns:={self._namespace}"
        if executable in self._words:
            line += f" {self._words[executable]()}"
        return f"{consequence}; for another one: {line}"

"""Nodes whose end does not end a laboratory: reported, with the command of another one."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import parameter_value_to_python

from flexarm_bringup.console import terminal
from flexarm_bringup.console.called import as_called
from flexarm_bringup.graph.processes import LaunchError, as_yaml
from flexarm_control.loop_setup import TOPIC
from flexarm_control.models.nominal_models import PREFIX
from flexarm_core.bounds import yaml_content
from flexarm_node import qos

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flexarm_bringup.graph.client import ServiceClient
    from flexarm_bringup.graph.processes import NodeProcesses

_WITHOUT = {
    "controller_node": ("flexarm_control", "the drive goes to zero"),
    "recorder_node": ("flexarm_daq", "nothing is recorded any more, and the arm goes on"),
    "experiment_node": ("flexarm_daq", "the arm goes on without experiments in open loop"),
    "ident_node": ("flexarm_ident", "the arm goes on without identification"),
}
"""Nodes that may be started by hand: their packages, and what the laboratory is without them."""
_OF_UP = "the arm goes on without it; to have it back, end this up by Ctrl-C and start it again"
# A node that is started anew gets its own, and shall not play a trajectory once more.
_NOT_AGAIN = ("listeners", "autostart", "use_sim_time", "trajectory")
_MODEL = ".model"
_PLAIN = (str, int, float)


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


class SetSince:
    """Parameters of the controller that have changed since it was started.

    Parameters
    ----------
    client : ServiceClient
        Client of the arm's nodes; changes are heard while it waits for something.
    name : str
        Name of the node.
    """

    def __init__(self, client: ServiceClient, name: str) -> None:
        self._node = client.full_name(name)
        self._values: dict[str, Any] = {}
        self._has_models = False
        client.listen(ParameterEvent, "/parameter_events", qos.EVERY, self._hear)

    def words(self, start: Mapping[str, Any]) -> str:
        """Return the parameters in force as ROS 2 takes them, given those of the start.

        Models that were set, whose entries are too long for a line, and the laws' choices of them
        are left out, and so is a trajectory that was set: it would be played once more.
        """
        values = {**start, **self._values}
        return " ".join(f"-p {shlex.quote(f'{n}:={_text(v)}')}" for n, v in values.items())

    def lost(self, start: Mapping[str, Any]) -> list[str]:
        """Return what another node begins with, since a line does not have it."""
        follows = {**start, **self._values}.get("reference", TOPIC)
        found = ["the set-point 0"] if follows == TOPIC else []
        return [*found, *(["the models of its start"] if self._has_models else [])]

    def _hear(self, event: ParameterEvent) -> None:
        if event.node != self._node:
            return
        # One that is started anew declares all of its own.
        for each in event.changed_parameters:
            if each.name not in _NOT_AGAIN and not each.name.startswith(PREFIX):
                value = parameter_value_to_python(each.value)
                self._values[each.name] = value if isinstance(value, _PLAIN) else list(value)
        both = (*event.new_parameters, *event.changed_parameters)
        models = [each.name.startswith(PREFIX) for each in both]
        self._has_models |= any(models)
        if self._has_models:
            self._values = {n: v for n, v in self._values.items() if not n.endswith(_MODEL)}


def _text(value: object) -> str:
    """Return a value as YAML; a word that YAML takes for itself stays bare."""
    is_word = isinstance(value, str) and value.isidentifier() and yaml_content(value) == value
    return str(value) if is_word else as_yaml(value)

"""Parameters of a node that were set while it ran, for another node in its place."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import parameter_value_to_python

from flexarm_bringup.graph.processes import as_yaml
from flexarm_control.loop_setup import TOPIC
from flexarm_control.models.chosen_model import PREFIX
from flexarm_core.bounds import yaml_content
from flexarm_node import qos

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexarm_bringup.graph.client import ServiceClient

# A node that is started anew gets its own, and shall not play a trajectory once more.
_NOT_AGAIN = ("listeners", "autostart", "use_sim_time", "trajectory")
_MODEL = ".model"
_PLAIN = (str, int, float)


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

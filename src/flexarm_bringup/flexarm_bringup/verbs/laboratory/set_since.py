"""Parameters of a node that were set while it ran, for another node in its place."""

from __future__ import annotations

import json
import shlex
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import parameter_value_to_python

from flexarm_control.models.chosen_model import PREFIX
from flexarm_node import qos

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexarm_bringup.graph.client import GraphClient

# A node that is started anew gets its own.
_OF_A_START = ("listeners", "autostart", "use_sim_time")


class SetSince:
    """Parameters of a node that have changed since it was started.

    Parameters
    ----------
    client : GraphClient
        Client of the arm's nodes; changes are heard while it waits for something.
    name : str
        Name of the node.

    Attributes
    ----------
    has_models : bool
        Whether a model was set. Its entries are too long for a line.
    """

    def __init__(self, client: GraphClient, name: str) -> None:
        self._node = client.full_name(name)
        self._values: dict[str, Any] = {}
        self.has_models = False
        client.listen(ParameterEvent, "/parameter_events", qos.EVERY, self._hear)

    def words(self, start: Mapping[str, Any]) -> str:
        """Return the parameters in force as ROS 2 takes them, given those of the start."""
        values = {**start, **self._values}
        return " ".join(f"-p {shlex.quote(f'{n}:={_text(v)}')}" for n, v in values.items())

    def _hear(self, event: ParameterEvent) -> None:
        if event.node != self._node:
            return
        # One that is started anew declares all of its own.
        for each in event.changed_parameters:
            if each.name not in _OF_A_START and not each.name.startswith(PREFIX):
                self._values[each.name] = parameter_value_to_python(each.value)
        both = (*event.new_parameters, *event.changed_parameters)
        self.has_models |= any(each.name.startswith(PREFIX) for each in both)


def _text(value: object) -> str:
    """Return a value as YAML in one line; a bare word stays one."""
    if isinstance(value, str) and value.isidentifier():
        return value
    is_list = not isinstance(value, str | int | float)
    return json.dumps(list(value) if is_list else value)  # type: ignore[call-overload]

"""The identification as a service of a live node."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.parameter import Parameter

from flexarm_msgs.srv import Identify

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph


def identify(graph: Graph, *bags: Path | str, **fields: Any) -> Identify.Response:  # noqa: ANN401
    """Call the service for some bags."""
    request = Identify.Request(bag_uris=[str(bag) for bag in bags], **fields)
    response: Identify.Response = graph.call(Identify, "identify", request)
    return response


def answered(response: Identify.Response) -> dict[str, Any]:
    """Return the parameters in a response by name."""
    return {
        message.name: as_plain(Parameter.from_parameter_msg(message).value)
        for message in response.parameters
    }


def as_plain(value: Any) -> Any:  # noqa: ANN401 - any parameter
    """Return arrays as lists."""
    return value if isinstance(value, (str, bool, int, float)) else list(value)

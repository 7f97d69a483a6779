"""Services of nodes, called from the server's event loop, and parameters as nodes describe them."""

from __future__ import annotations

import asyncio
import math
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterType
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter, parameter_value_to_python

from flexarm_core.clock import Patience
from flexarm_core.errors import FlexarmError, nearest

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rclpy.client import Client
    from rclpy.node import Node
    from rclpy.task import Future

# Tolerance of rclpy at the ends of a range.
_AT_AN_END = 1e-6
_KINDS = {
    ParameterType.PARAMETER_BOOL: "bool",
    ParameterType.PARAMETER_INTEGER: "integer",
    ParameterType.PARAMETER_DOUBLE: "double",
    ParameterType.PARAMETER_STRING: "string",
}
# Discovered before they are needed, and so among what a policy of SROS2 allows.
_SERVICES = {
    ListParameters: "list_parameters",
    DescribeParameters: "describe_parameters",
    GetParameters: "get_parameters",
    SetParametersAtomically: "set_parameters_atomically",
}
# What rclpy declares by itself.
_OTHERS = ("qos_overrides.", "start_type_description_service", "use_sim_time", "models.")
_POLL_S = 0.02
_UNHEARD_S = 0.5
"""Patience with one question before it is put again."""
CALL_S = 15.0
"""Patience with what usually takes a moment."""


class NodeParameters:
    """Parameters of one node, read once and kept up to date by its events.

    Attributes
    ----------
    values : dict of str to value
        Values by name; empty until `load`.
    """

    def __init__(self, calls: Calls, node: str) -> None:
        self._calls = calls
        self._node = node
        self._descriptors: dict[str, ParameterDescriptor] = {}
        self.values: dict[str, Any] = {}
        for kind, service in _SERVICES.items():
            calls.client(kind, f"{node}/{service}")

    @property
    def are_there(self) -> bool:
        """Whether the node is known to answer questions about them."""
        client = self._calls.client(ListParameters, f"{self._node}/list_parameters")
        return bool(client.service_is_ready())

    async def load(self) -> None:
        """Read names, descriptions and values, where that was not done yet."""
        if self.values:
            return
        node = self._node
        listed = await self._calls.call(
            ListParameters, f"{node}/list_parameters", ListParameters.Request()
        )
        names = own_names(listed.result.names)
        described = await self._calls.call(
            DescribeParameters,
            f"{node}/describe_parameters",
            DescribeParameters.Request(names=names),
        )
        values = await self._values_of(names)
        self._descriptors = {each.name: each for each in described.descriptors}
        self.values = values

    async def look_again(self) -> dict[str, Any]:
        """Read the values again, or all; return those that another process of the node has."""
        if not self.values:
            await self.load()
            return {}
        found = await self._values_of(list(self.values))
        changed = {name: value for name, value in found.items() if value != self.values[name]}
        self.values = {**self.values, **changed}
        return changed

    async def _values_of(self, names: list[str]) -> dict[str, Any]:
        answer = await self._calls.call(
            GetParameters, f"{self._node}/get_parameters", GetParameters.Request(names=names)
        )
        return dict(zip(names, map(parameter_value_to_python, answer.values), strict=True))

    def update(self, changed: Iterable[Any]) -> dict[str, Any]:
        """Take the changes of an event; return those of parameters that are shown."""
        new = {each.name: parameter_value_to_python(each.value) for each in changed}
        known = {name: value for name, value in new.items() if name in self.values}
        self.values = {**self.values, **known}
        return known

    def shown(self) -> list[dict[str, Any]]:
        """Return every parameter with its description, in the order of the node."""
        return [
            shown(descriptor, self.values[name]) for name, descriptor in self._descriptors.items()
        ]

    async def set(self, wanted: Mapping[str, Any]) -> None:
        """Set parameters, all or none; a whole number is taken for a float where one is wanted.

        Raises
        ------
        CallError
            When the node has no such parameter, or refuses.
        """
        await self.load()
        request = SetParametersAtomically.Request(
            parameters=[
                Parameter(name, value=self._as_kind(name, value)).to_parameter_msg()
                for name, value in wanted.items()
            ]
        )
        service = f"{self._node}/set_parameters_atomically"
        result = (await self._calls.call(SetParametersAtomically, service, request)).result
        if not result.successful:
            raise CallError(f"{self._node} refused: {result.reason}")

    def _as_kind(self, name: str, value: object) -> object:
        if name not in self.values:
            if name.startswith("models."):
                return value
            raise CallError(f"{self._node} has no parameter {name}{nearest(name, self.values)}")
        descriptor = self._descriptors[name]
        wants_float = descriptor.type == ParameterType.PARAMETER_DOUBLE
        is_whole = isinstance(value, int) and not isinstance(value, bool)
        if is_whole or isinstance(value, float):
            self._require_in_range(shown(descriptor, value))
        return float(value) if wants_float and is_whole else value  # type: ignore[arg-type]

    def _require_in_range(self, wanted: Mapping[str, Any]) -> None:
        """Refuse a number out of its range, which the node would do without its unit."""
        low, high = wanted["low"], wanted["high"]
        name, value, unit = wanted["name"], wanted["value"], wanted["unit"]
        if low is None or low <= value <= high:
            return
        # As near to an end the node takes it.
        if not any(math.isclose(value, end, rel_tol=_AT_AN_END) for end in (low, high)):
            ends = f"{low:g} to {high:g} {unit}".rstrip()
            raise CallError(f"{self._node}: {name} = {value:g} is not within {ends}")


def own_names(listed: Iterable[str]) -> list[str]:
    """Return the names of a node's own parameters, without those of every node and of models."""
    return [name for name in listed if not name.startswith(_OTHERS)]


def shown(descriptor: ParameterDescriptor, value: object) -> dict[str, Any]:
    """Return one parameter as a page gets it; the inverse of `flexarm_node.parameters`."""
    words = dict(
        word.partition(": ")[::2] for word in descriptor.additional_constraints.split("; ")
    )
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    return {
        "name": descriptor.name,
        "value": value,
        "kind": _KINDS.get(descriptor.type, "array"),
        "unit": words.get("unit", ""),
        "low": ranges[0].from_value if ranges else None,
        "high": ranges[0].to_value if ranges else None,
        "choices": words["one of"].split(", ") if "one of" in words else [],
        "read_only": descriptor.read_only,
        "live": "a change acts at once" in words,
        "description": descriptor.description,
    }


class CallError(FlexarmError):
    """A service that does not answer, or refuses."""


class SilentNodeError(CallError):
    """A service or its answer that did not come in time."""


class Calls:
    """Clients of the services of one arm.

    Parameters
    ----------
    node : Node
        Node for the clients, in the namespace of the arm; an executor spins it.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._clients: dict[tuple[type, str], Client] = {}

    def client(self, kind: type, name: str) -> Client:
        """Return the client of a service below the namespace: only the first is discovered."""
        key = (kind, name)
        if key not in self._clients:
            self._clients[key] = self._node.create_client(kind, name)
        return self._clients[key]

    async def call(
        self,
        kind: type,
        name: str,
        request: object,
        timeout_s: float = CALL_S,
        *,
        again_s: float = _UNHEARD_S,
    ) -> Any:  # noqa: ANN401 - the service's own response type
        """Call a service and return its response.

        A server that has not yet discovered the client's reader drops its answer, so the question
        is put again when no answer comes for `again_s`; infinity puts it once.

        Raises
        ------
        SilentNodeError
            When the service or its answer does not come in time.
        CallError
            When the node refuses the call.
        """
        client = self.client(kind, name)
        patience = Patience(timeout_s)
        while not client.service_is_ready():
            if patience.is_over:
                raise SilentNodeError(f"{client.service_name} does not answer: is its node there?")
            await asyncio.sleep(_POLL_S)
        answers: list[asyncio.Future[Any]] = []
        while not patience.is_over:
            answers.append(settled(client.call_async(request)))
            done, _ = await asyncio.wait(
                answers, timeout=min(again_s, timeout_s), return_when=asyncio.FIRST_COMPLETED
            )
            if done:
                return done.pop().result()
        raise SilentNodeError(
            f"{client.service_name} did not answer within {patience.waited_s:.0f} s: its node "
            "hangs, or the machine is busy. What was asked for may still come into force"
        )


def settled(future: Future[Any]) -> asyncio.Future[Any]:
    """Return a future of this event loop that ends with one of rclpy."""
    loop = asyncio.get_running_loop()
    here: asyncio.Future[Any] = loop.create_future()

    def settle() -> None:
        if here.done():
            return
        error = future.exception()
        if error is None:
            here.set_result(future.result())
        else:
            here.set_exception(CallError(str(error)))

    def on_done(_: Future[Any]) -> None:
        if not loop.is_closed():
            loop.call_soon_threadsafe(settle)

    future.add_done_callback(on_done)
    return here

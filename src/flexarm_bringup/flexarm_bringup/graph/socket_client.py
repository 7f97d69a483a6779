"""Client of a running arm over the Unix socket of its `up`, lines of JSON, or over the graph.

A start of rclpy and a discovery take seconds, a connection to the socket takes a millisecond.
"""

from __future__ import annotations

import json
import math
import time
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeVar

from flexarm_bringup.graph.assignments import assigned
from flexarm_bringup.graph.figures import SetPoint
from flexarm_bringup.graph.processes import LaunchError
from flexarm_core.clock import slowness
from flexarm_core.errors import one_line
from flexarm_core.own_files import OwnFileError
from flexarm_live.terminal_socket import connect, namespaces
from flexarm_node.parameter_files import LOOP

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from flexarm_bringup.graph.graph_client import GraphClient

    ArmClient: TypeAlias = "SocketClient | GraphClient"

_STOP_S = 1.0
"""Patience with a stop: the graph is asked then."""
_TRANSITION_S = 60.0
_USUAL_S = 5.0
_FIRST_REPORTS_S = 2.0
"""Reports come once a second."""
_POLL_S = 0.1
_LONGEST = 4 << 20
_NODES = (*LOOP, "recorder", "ident")
"""Nodes whose parameters `up` knows."""
_MODELS = "models."
Result = TypeVar("Result")


class NoAnswerError(LaunchError):
    """No `up` of the arm answers, or what is asked for is none of its nodes'."""


class SilentUpError(NoAnswerError):
    """An `up` runs, and has not done in time what was asked of it."""


class Answer(NamedTuple):
    """Answer to a request that was carried out."""

    message: str
    data: Mapping[str, Any]


@contextmanager
def socket_client(namespace: str) -> Iterator[SocketClient]:
    """Connect to the `up` of an arm; a `NoAnswerError` when there is none."""
    try:
        connection = connect(namespace)
    except (OSError, OwnFileError) as error:
        raise NoAnswerError(f"no page of a `flexarm up` of {namespace} answers here") from error
    with connection:
        yield SocketClient(connection)


class SocketClient:
    """Client of the arm at the other end of a connection; a `LaunchError` says what was refused."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._replies = connection.makefile("rb")

    def ask(self, verb: str, patience_s: float = _USUAL_S, **fields: object) -> Answer:
        """Send a request and return its answer.

        Raises
        ------
        SilentUpError
            When none comes in time.
        LaunchError
            When the request is refused.
        """
        request = json.dumps({"id": 0, "do": verb, **fields}).encode()
        try:
            # The graph is asked when a stop is not answered: that is not put off.
            self._connection.settimeout(patience_s * (1.0 if verb == "stop" else slowness()))
            self._connection.sendall(request + b"\n")
            reply = json.loads(self._replies.readline(_LONGEST))
            carried_out, answer = reply["ok"], Answer(reply["message"], reply["data"])
        except (OSError, ValueError, LookupError, TypeError) as error:
            raise SilentUpError(f"no answer to {verb}: {one_line(error)}") from error
        if not carried_out:
            raise LaunchError(answer.message)
        return answer

    def stop(self) -> str:
        """Hold the drive at zero; whatever hinders that here, the graph has to be tried."""
        try:
            return self.ask("stop", _STOP_S).message
        except LaunchError as error:
            raise SilentUpError(
                f"{one_line(error)}; the drive may be on: press the button at the rig"
            ) from error

    def reports(self) -> Mapping[str, tuple[str, Mapping[str, str]]]:
        """Return the message and the figures of each node that reports.

        An `up` that has just begun is given the time of the first reports.
        """
        deadline_s = time.monotonic() + _FIRST_REPORTS_S
        while "daq" not in (reports := self.ask("status").data["reports"]):
            if time.monotonic() >= deadline_s:
                break
            time.sleep(_POLL_S)
        return {name: (each["message"], each["values"]) for name, each in reports.items()}

    def page(self) -> str:
        """Return the address of the arm's page; over the graph there is none."""
        return str(self.ask("address").data["url"])

    def reference(self, value: float, joint: str = "") -> SetPoint:
        """Give the controller a set-point, V of the thesis's arm; return the one in force."""
        named: dict[str, Any] = {"value": value} | ({"joint": joint} if joint else {})
        data = self.ask("reference", **named).data
        return SetPoint(float(data["value"]), str(data.get("note", "")))

    def parameters(self, node: str) -> Mapping[str, Sequence[Mapping[str, Any]]]:
        """Return the parameters of a node, or of every one, with values, bounds and units.

        Each is a mapping of `name`, `value`, `unit`, `low`, `high`, `choices`, `read_only`, `live`
        and `description`.
        """
        if not node:
            return self.ask("get").data["nodes"]  # type: ignore[no-any-return]
        _require(node, _NODES)
        return {node: self.ask("get", node=node).data["params"]}

    def set(self, node: str, values: Mapping[str, Any]) -> Mapping[str, tuple[Any, Any]]:
        """Set parameters of a node, all or none; return the former and the new values."""
        if len(values) > 1 or any(name.startswith(_MODELS) for name in values):
            raise NoAnswerError("`up` sets one parameter, and none of a model")
        before = {each["name"]: each["value"] for each in self.parameters(node)[node]}
        changes = assigned(node, values, before)
        if any(isinstance(each, float) and not math.isfinite(each) for each in changes.values()):
            raise NoAnswerError("JSON has no such number: the node itself says what it takes")
        for name, value in changes.items():
            self.ask("set", node=node, name=name, value=value)
        return {name: (before[name], value) for name, value in changes.items()}

    def activate(self, node: str) -> str:
        """Activate a node of the loop and return its state."""
        _require(node, LOOP)
        self.ask("activate", _TRANSITION_S, node=node)
        return "active"

    def deactivate(self, node: str) -> str:
        """Deactivate a node of the loop and return its state."""
        _require(node, LOOP)
        self.ask("deactivate", _TRANSITION_S, node=node)
        return "inactive"


def _require(node: str, known: Collection[str]) -> None:
    """Refuse a misspelt node, and leave others to the graph."""
    if node in known:
        return
    for near in get_close_matches(node, known, n=1):
        raise LaunchError(f"no node {node} (nearest: {near})")
    raise NoAnswerError(f"{node} is not a node of `up`")


def through(namespace: str, do: Callable[[ArmClient], Result]) -> Result:
    """Do something over the socket of `up`; over the graph where that is not there or not enough.

    Parameters
    ----------
    namespace : str
        Namespace of the arm.
    do : callable
        Called with the client, perhaps twice: what it asks for may be asked for again.
    """
    try:
        with socket_client(namespace) as arm:
            return do(arm)
    except SilentUpError as silent:
        try:
            return _through_graph(namespace, do)
        except LaunchError as error:
            raise LaunchError(
                f"{silent} (`flexarm up` runs here, so a node hangs or the machine is busy, and "
                f"what was asked for may still be done; over the graph: {one_line(error)})"
            ) from error
    except NoAnswerError:
        return _through_graph(namespace, do)


def _through_graph(namespace: str, do: Callable[[ArmClient], Result]) -> Result:
    from flexarm_bringup.graph.graph_client import graph_client  # noqa: PLC0415 - it loads rclpy

    with graph_client(namespace) as arm:
        return do(arm)


def stop_every_arm() -> Iterator[tuple[str, str]]:
    """Stop each arm: at once where an `up` answers, the others as the graph shows them.

    Yields
    ------
    tuple of str
        Namespace of an arm, and what its DAQ node says.

    Raises
    ------
    LaunchError
        When there is none, or one does not answer.
    """
    stopped = set()
    for arm, message in _stopped_over_sockets():
        stopped.add(arm)
        yield arm, message
    from flexarm_bringup.graph.graph_client import stop_arms_of_graph  # noqa: PLC0415 - as above

    yield from stop_arms_of_graph(stopped)


def _stopped_over_sockets() -> Iterator[tuple[str, str]]:
    """Ask every `up` at the same time: one that hangs holds up no other."""
    # A stop of one arm shall not wait for it to load.
    from concurrent.futures import ThreadPoolExecutor, as_completed  # noqa: PLC0415

    def stop(namespace: str) -> str:
        with socket_client(namespace) as arm:
            return arm.stop()

    try:
        found = namespaces()
    except (OSError, OwnFileError):
        return
    with ThreadPoolExecutor(max(1, len(found))) as pool:
        asked = {pool.submit(stop, namespace): namespace for namespace in found}
        for answer in as_completed(asked):
            with suppress(NoAnswerError):
                yield asked[answer], answer.result()

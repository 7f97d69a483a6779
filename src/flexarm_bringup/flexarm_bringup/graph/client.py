"""Client of the graph: services and topics, waited for with deadlines."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters
from std_srvs.srv import Trigger

from flexarm_bringup.console import terminal
from flexarm_bringup.graph.processes import LaunchError
from flexarm_core.clock import Patience
from flexarm_msgs.srv import Identify, Tune

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.client import Client
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from rclpy.task import Future

SERVICE_S = 30.0
"""Deadline of operations that usually take a moment."""
_UNHEARD_S = 3.0
_SOON_S = 0.1
_HARMLESS = {GetState: _SOON_S, GetParameters: _SOON_S, Trigger: 0.5}
"""Patience with questions that do no harm twice: they may soon be put again, twice as late each
time. What is triggered takes a while."""
_ASKED_ONCE = {Identify: "ident", Tune: "tuner"}
"""Long work and its node: a second question would be refused while the first is at work."""
_REPORT_S = 5.0
_POLL_S = 0.1
_SERVICE_POLL_S = 0.02
"""A service that is discovered wakes nobody up."""


class Waiting:
    """Wait for another process, and say so to the user when it takes long.

    Parameters
    ----------
    what : str
        What is waited for; empty to say nothing.
    longest_s : float
        Patience on an idle machine, s.
    """

    def __init__(self, what: str, longest_s: float) -> None:
        self._what = what
        self._patience = Patience(longest_s)
        self._reported_s = 0.0

    def look(self) -> None:
        """Tell of the wait now and then; raise a `LaunchError` when it has taken too long."""
        waited_s = self._patience.waited_s
        if self._patience.is_over:
            raise LaunchError(f"{self._what} did not come within {waited_s:.0f} s")
        if self._what and waited_s > self._reported_s + _REPORT_S:
            self._reported_s = waited_s
            terminal.CONSOLE.print(f"  waiting for {self._what}, {waited_s:.0f} s so far")


class ServiceClient:
    """Client of the nodes of one arm.

    Parameters
    ----------
    node : Node
        Node for the clients and the readers, in the namespace of the arm.
    executor : SingleThreadedExecutor
        Executor that spins it.
    check : callable
        Called while waiting; raises when a process has ended.
    """

    def __init__(
        self, node: Node, executor: SingleThreadedExecutor, check: Callable[[], None]
    ) -> None:
        self.node = node
        self._executor = executor
        self._check = check
        self._clients: dict[tuple[type, str], Client] = {}

    def listen(
        self, kind: type, topic: str, profile: QoSProfile, heard: Callable[[Any], None]
    ) -> None:
        """Hand every message of a topic to a function, while something is waited for."""
        self.node.create_subscription(kind, topic, heard, profile)

    @property
    def namespace(self) -> str:
        """Namespace of the arm."""
        return str(self.node.get_namespace())

    def full_name(self, name: str) -> str:
        """Return the full name of a node of this arm."""
        return f"{self.namespace.rstrip('/')}/{name}"

    def nodes(self) -> set[str]:
        """Return the full names of the nodes that are there."""
        return {
            f"{space.rstrip('/')}/{name}"
            for name, space in self.node.get_node_names_and_namespaces()
        }

    def spin(self, poll_s: float = _POLL_S) -> None:
        """Handle what has come, or wait a moment for it."""
        self._check()
        self._executor.spin_once(timeout_sec=poll_s)

    def wait(
        self,
        condition: Callable[[], bool],
        what: str,
        timeout_s: float = SERVICE_S,
        *,
        poll_s: float = _POLL_S,
    ) -> None:
        """Spin until the condition holds; raise a `LaunchError` after the time.

        The time counts as `Patience` has it. The condition is asked after each piece of work, and
        at the latest after the time of a poll.
        """
        waiting = Waiting(what, timeout_s)
        while not condition():
            waiting.look()
            self.spin(poll_s)

    def acquaint(self, name: str, timeout_s: float = SERVICE_S) -> None:
        """Wait until a node knows all the clients and readers that were made here so far.

        Discovery announces them in the order in which they were made. So a node that answers the
        newest client knows all of them, and none of its later answers is dropped.
        """
        client = self.node.create_client(GetParameters, f"{name}/get_parameters")
        try:
            self._ask(client, GetParameters.Request(), timeout_s, patience_s=_SOON_S)
        finally:
            self.node.destroy_client(client)

    def call(
        self,
        service: type,
        name: str,
        request: object,
        timeout_s: float = SERVICE_S,
        unheard: Callable[[], object | None] = lambda: None,
    ) -> Any:  # noqa: ANN401 - the service's own response type
        """Call a service below the namespace and return its response.

        A server that has not yet discovered the client's reader drops its answer. So the
        question is put again when no answer comes for a while, unless `unheard` infers the answer.

        Raises
        ------
        LaunchError
            When the service or its answer does not come in time.
        """
        if service in _ASKED_ONCE:
            return self.begin(service, name, request, timeout_s)()
        patience_s = _HARMLESS.get(service, _UNHEARD_S)
        client = self.client(service, name)
        return self._ask(client, request, timeout_s, patience_s=patience_s, unheard=unheard)

    def begin(
        self, service: type, name: str, request: object, timeout_s: float
    ) -> Callable[[], Any]:
        """Ask once for long work below the namespace; the result waits for the answer.

        Raises
        ------
        LaunchError
            When the service does not come in time; later, when its answer does not.
        """
        client = self.client(service, name)
        self.acquaint(_ASKED_ONCE[service], max(timeout_s, SERVICE_S))
        self.await_service(client, timeout_s)
        answer = client.call_async(request)

        def answered() -> Any:  # noqa: ANN401 - the service's own response type
            self.wait(answer.done, f"the answer of {client.service_name}", timeout_s)
            return answer.result()

        return answered

    def client(self, service: type, name: str) -> Client:
        """Return the client of a service below the namespace: only the first is discovered."""
        key = (service, name)
        if key not in self._clients:
            self._clients[key] = self.node.create_client(service, name)
        return self._clients[key]

    def _ask(
        self,
        client: Client,
        request: object,
        timeout_s: float,
        *,
        patience_s: float,
        unheard: Callable[[], object | None] = lambda: None,
    ) -> Any:  # noqa: ANN401 - the service's own response type
        self.await_service(client, timeout_s)
        waiting = Waiting(f"the answer of {client.service_name}", timeout_s)
        answers: list[Future[Any]] = []
        while True:
            answers.append(client.call_async(request))
            until_s = time.monotonic() + patience_s
            while time.monotonic() < until_s:
                waiting.look()
                for answer in answers:
                    if answer.done():
                        return answer.result()
                self.spin()
            if (inferred := unheard()) is not None:
                return inferred
            patience_s = min(2.0 * patience_s, _UNHEARD_S)

    def await_service(self, client: Client, timeout_s: float = SERVICE_S) -> None:
        """Wait until a service is there."""
        name, longest_s = f"service {client.service_name}", max(timeout_s, SERVICE_S)
        self.wait(client.service_is_ready, name, longest_s, poll_s=_SERVICE_POLL_S)

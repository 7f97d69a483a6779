"""Calls of services from the server's event loop, answered in the executor's thread."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from flexarm_core.errors import FlexarmError
from flexarm_core.patience import Patience

if TYPE_CHECKING:
    from rclpy.client import Client
    from rclpy.node import Node
    from rclpy.task import Future

_POLL_S = 0.02
_UNHEARD_S = 0.5
"""Patience with one question before it is put again."""
CALL_S = 15.0
"""Patience with what usually takes a moment."""


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

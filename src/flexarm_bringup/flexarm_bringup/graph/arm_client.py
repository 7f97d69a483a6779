"""Client of a running arm: what a verb may ask of it, over the socket of `up` or the graph.

A start of rclpy and a discovery take seconds, a connection to the socket takes a millisecond.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, TypeVar

from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.graph.socket_client import NoAnswerError, SilentUpError, socket_client
from flexarm_core.errors import one_line
from flexarm_core.own_files import OwnFileError
from flexarm_live.terminal_socket import namespaces

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flexarm_bringup.graph.graph_client import GraphClient
    from flexarm_bringup.graph.socket_client import SocketClient

    ArmClient = SocketClient | GraphClient

Result = TypeVar("Result")


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

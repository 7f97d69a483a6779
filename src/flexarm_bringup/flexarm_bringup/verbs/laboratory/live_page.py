"""Page of a running laboratory and other viewers: options, and addresses on the terminal."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import wraps
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flexarm_bags.schema import share_of
from flexarm_bringup.console import terminal
from flexarm_bringup.graph.client import Waiting
from flexarm_bringup.graph.socket_client import NoAnswerError, socket_client
from flexarm_core.channels import is_thesis_arm
from flexarm_core.rig_description import load_rig
from flexarm_live.serving.foxglove_server import USUAL_PORT

if TYPE_CHECKING:
    from collections.abc import Callable

    from flexarm_bringup.graph.processes import NodeProcesses

PAGE_NODE = "live"
_EXECUTABLE = "live_node"
_FOLDER = Path("out/live")
FOXGLOVE_NODE = "foxglove"
_FOXGLOVE_EXECUTABLE = "foxglove_node"
FOXGLOVE = click.option(
    "--foxglove",
    "foxglove_port",
    type=click.IntRange(1, 65535),
    is_flag=False,
    flag_value=USUAL_PORT,
    metavar="[PORT]",
    help=f"Serve the topics to Foxglove, Lichtblick and PlotJuggler; port {USUAL_PORT} by default.",
)


@dataclass(frozen=True)
class PageSettings:
    """Choices of the user about the page."""

    port: int
    view_only: bool

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the node that serves it."""
        return {**asdict(self), "folder": _FOLDER.absolute()}


def page_options(function: Callable[..., None]) -> Callable[..., None]:
    """Add the options of the page to a verb, which gets them as one `page`; None for no page."""

    @click.option(
        "--no-page",
        is_flag=True,
        help="Serve no page in the browser; verbs then take seconds, over the graph.",
    )
    @click.option(
        "--port",
        type=click.IntRange(0, 65535),
        default=0,
        help="Port of the page; by default 8117, or a free one when that is taken.",
    )
    @click.option("--view-only", is_flag=True, help="The page shows the arm and commands nothing.")
    @wraps(function)
    def verb(*, no_page: bool, port: int, view_only: bool, **settings: Any) -> None:  # noqa: ANN401
        page = None if no_page else PageSettings(port, view_only)
        function(page=page, **settings)

    return verb


class Address:
    """Address that a node serves, shown alone on a line as soon as it is there.

    The end of the node is that of the laboratory before, such as for a port that is taken, and not
    afterwards.

    Parameters
    ----------
    processes : NodeProcesses
        Nodes of the laboratory.
    executable : str
        Executable of the node that serves it.
    find : callable
        Returns the address; empty while it is not served.
    """

    def __init__(self, processes: NodeProcesses, executable: str, find: Callable[[], str]) -> None:
        self._processes = processes
        self._executable = executable
        self._find = find
        self._is_shown = False
        self._waiting = Waiting(f"the address of {executable}", inf)

    def look(self) -> bool:
        """Show the address when it is there and was not shown; return whether it was."""
        if not self._is_shown and (address := self._find()):
            self._is_shown = True
            self._processes.let_be_replaced(self._executable)
            terminal.CONSOLE.print(address, highlight=False, soft_wrap=True)
        if not self._is_shown:
            self._waiting.look()
        return self._is_shown


class PageAddress(Address):
    """Address of the page of an arm."""

    def __init__(self, namespace: str, processes: NodeProcesses) -> None:
        super().__init__(processes, _EXECUTABLE, lambda: _address(namespace))


class FoxgloveAddress(Address):
    """Address for the viewers, which their node gives."""

    def __init__(self, processes: NodeProcesses) -> None:
        super().__init__(
            processes, _FOXGLOVE_EXECUTABLE, lambda: processes.announcement(FOXGLOVE_NODE)
        )


def foxglove_parameters(port: int, rig: str) -> dict[str, Any]:
    """Return the parameters of the node, with the shape of the arm.

    That of the thesis's arm is a file, where the package has it.
    """
    if not is_thesis_arm(load_rig(rig)):
        return {"port": port, "rig": rig}
    share = share_of("flexarm_bringup")
    return {"port": port} | ({} if share is None else {"urdf": share / "urdf" / "flexarm.urdf"})


def announce_task(namespace: str, words: str) -> None:
    """Tell the page of an arm what it is used for now, unless it has gone."""
    with suppress(NoAnswerError), socket_client(namespace) as page:
        page.ask("task", text=words)


def _address(namespace: str) -> str:
    """Return the address of the page of an arm; empty while it is not served."""
    try:
        with socket_client(namespace) as page:
            return page.page()
    except NoAnswerError:
        return ""

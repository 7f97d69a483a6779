"""Page of a running laboratory: its options, and its address on the terminal."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.graph.processes import LaunchError
from flexarm_live.terminal_socket import connect

if TYPE_CHECKING:
    from collections.abc import Callable

    from flexarm_bringup.graph.operator import Operator
    from flexarm_bringup.graph.processes import NodeProcesses

PAGE_NODE = "live"
_EXECUTABLE = "live_node"
_FOLDER = Path("out/live")
_ADDRESS = '{"do": "address"}\n'


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

    @click.option("--no-page", is_flag=True, help="Serve no page in the browser.")
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


def show_address(operator: Operator, processes: NodeProcesses) -> None:
    """Print the address of the page alone on a line, as soon as it is served.

    Raises
    ------
    LaunchError
        When the node has ended, such as for a port that is taken.
    """
    found: list[str] = []

    def is_served() -> bool:
        if address := _address(operator.namespace):
            found.append(address)
        return bool(found)

    operator.wait(is_served, "the page")
    # The laboratory goes on without it.
    processes.let_be_replaced(_EXECUTABLE)
    terminal.CONSOLE.print(found[0], markup=False, highlight=False, soft_wrap=True)


def _address(namespace: str) -> str:
    """Return the address of the page of an arm; empty while it is not served."""
    try:
        with connect(namespace) as laboratory, laboratory.makefile("rw") as lines:
            lines.write(_ADDRESS)
            lines.flush()
            return str(json.loads(lines.readline())["data"]["url"])
    except OSError:
        return ""
    except (ValueError, KeyError) as error:
        raise LaunchError(f"the page gave no address: {error}") from error

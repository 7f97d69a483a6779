"""Foxglove and other viewers of a running laboratory: the option, and the address to open."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from flexarm_bags.schema import share_of
from flexarm_bringup.console import terminal
from flexarm_live.serving.foxglove_server import USUAL_PORT

if TYPE_CHECKING:
    from flexarm_bringup.graph.processes import NodeProcesses

FOXGLOVE_NODE = "foxglove"
_EXECUTABLE = "foxglove_node"
FOXGLOVE = click.option(
    "--foxglove",
    "foxglove_port",
    type=click.IntRange(1, 65535),
    is_flag=False,
    flag_value=USUAL_PORT,
    metavar="[PORT]",
    help=f"Serve the topics to Foxglove, Lichtblick and PlotJuggler; port {USUAL_PORT} by default.",
)


def foxglove_parameters(port: int) -> dict[str, Any]:
    """Return the parameters of the node, with the arm's description where the package has it."""
    share = share_of("flexarm_bringup")
    return {"port": port} | ({} if share is None else {"urdf": share / "urdf" / "flexarm.urdf"})


class FoxgloveAddress:
    """Address for the viewers, shown as soon as their node serves it.

    The end of the node is that of the laboratory before, such as for a port that is taken, and not
    afterwards.
    """

    def __init__(self, processes: NodeProcesses) -> None:
        self._processes = processes
        self._is_shown = False

    def look(self) -> None:
        """Show the address when the node has told it and it was not shown."""
        if self._is_shown or not (told := self._processes.announcement(FOXGLOVE_NODE)):
            return
        self._is_shown = True
        self._processes.let_be_replaced(_EXECUTABLE)
        terminal.CONSOLE.print(told, markup=False, highlight=False, soft_wrap=True)

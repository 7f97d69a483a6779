"""Foxglove and other viewers of a running laboratory: the option, and the address to open."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from flexarm_bags.schema import share_of
from flexarm_bringup.verbs.laboratory.live_page import Address
from flexarm_core.channels import is_thesis_arm
from flexarm_core.rig_description import load_rig
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


def foxglove_parameters(port: int, rig: str) -> dict[str, Any]:
    """Return the parameters of the node, with the shape of the arm.

    That of the thesis's arm is a file, where the package has it.
    """
    if not is_thesis_arm(load_rig(rig)):
        return {"port": port, "rig": rig}
    share = share_of("flexarm_bringup")
    return {"port": port} | ({} if share is None else {"urdf": share / "urdf" / "flexarm.urdf"})


class FoxgloveAddress(Address):
    """Address for the viewers, which their node tells."""

    def __init__(self, processes: NodeProcesses) -> None:
        super().__init__(processes, _EXECUTABLE, lambda: processes.announcement(FOXGLOVE_NODE))

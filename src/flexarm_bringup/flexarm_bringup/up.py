"""The graph, kept until Ctrl-C."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from flexarm_bringup import terminal
from flexarm_bringup.graph import running_graph


def run_graph(*, payload_kg: float, rate_hz: float, reference: str, bag: Path | None) -> None:
    """Start daq, controller, recorder and ident; sample until Ctrl-C.

    Parameters
    ----------
    payload_kg, rate_hz
        Of the simulated rig.
    reference
        `topic`, or the name of a built-in profile.
    bag
        Folder to record into; None records nothing.

    Raises
    ------
    LaunchError
        When a node does not start or ends by itself.
    """
    parameters: dict[str, dict[str, Any]] = {
        "daq": {"payload_kg": payload_kg, "rate_hz": rate_hz},
        "controller": {"law": "pdpc", "reference": reference},
        "recorder": {"bag": str(bag.absolute())} if bag else {},
    }
    with (
        TemporaryDirectory(prefix="flexarm_") as folder,
        running_graph(parameters, Path(folder, "nodes.log")) as (operator, processes),
    ):
        operator.activate("daq")
        terminal.CONSOLE.print(
            f"/flexarm is up: PDPC at {rate_hz:g} Hz, reference: {reference}. Ctrl-C ends it."
        )
        try:
            operator.wait(lambda: False, "nothing", timeout_s=float("inf"))
        except KeyboardInterrupt:
            terminal.CONSOLE.print("stopping")
        finally:
            processes.check()
    if bag:
        terminal.CONSOLE.print(f"recorded in {bag}", markup=False)

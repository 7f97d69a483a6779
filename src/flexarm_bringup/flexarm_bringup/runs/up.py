"""The graph, kept until Ctrl-C."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from flexarm_bringup.console import terminal
from flexarm_bringup.graph.laboratory import running_graph
from flexarm_bringup.graph.processes import LaunchError

if TYPE_CHECKING:
    from flexarm_bringup.runs.pace import Pace

_REPLACE = (
    "the drive is at zero; for another one: "
    "flexarm run flexarm_control controller_node --ros-args -p autostart:=true"
)
_ERRORS = ("[ERROR]", "[FATAL]")
_COMPLAINTS = ("[WARN]", *_ERRORS)
_CONTROLLER = "controller_node"


@dataclass(frozen=True)
class UpSettings:
    """What a graph starts with.

    Attributes
    ----------
    payload_kg, rate_hz
        Of the simulated rig.
    law
        Law of the controller, by its name.
    reference
        `topic`, or the name of a built-in profile.
    bag
        Folder to record into, with what the nodes print beside it; None records nothing.
    pace
        Wall clock or hard real time.
    parameter_files
        As for `--params-file` of ROS 2, such as the gains from `tune`.
    """

    payload_kg: float
    rate_hz: float
    law: str
    reference: str
    bag: Path | None
    pace: Pace
    parameter_files: tuple[Path, ...]


def run_graph(settings: UpSettings) -> None:
    """Start daq, controller, recorder and ident; sample until Ctrl-C, show what they complain of.

    A controller that ends leaves the arm to itself, with the drive at zero: another one may be
    started in its place.

    Raises
    ------
    LaunchError
        When the bag is there already, a node does not start or ends by itself, or the recording
        does.
    """
    bag = settings.bag
    if bag and bag.exists():
        raise LaunchError(f"{bag} is there already and is not overwritten: choose another name")
    parameters: dict[str, dict[str, Any]] = {
        "daq": {
            "payload_kg": settings.payload_kg,
            "rate_hz": settings.rate_hz,
            **settings.pace.parameters(),
        },
        "controller": {"law": settings.law, "reference": settings.reference},
    }
    with TemporaryDirectory(prefix="flexarm_") as folder:
        log = bag.with_name(f"{bag.name}.log") if bag else Path(folder, "nodes.log")
        complaints = _Complaints(log)
        try:
            with running_graph(parameters, log.absolute(), files=settings.parameter_files) as (
                operator,
                processes,
            ):
                if bag:
                    # Not before all nodes have taken their parameters: a refused start shall not
                    # leave an empty bag in the way of the next one.
                    operator.record(str(bag.absolute()))
                operator.activate("controller")
                operator.start_sampling()
                terminal.CONSOLE.print(
                    f"/flexarm is up: {settings.law} at {settings.rate_hz:g} Hz, "
                    f"reference: {settings.reference}. Ctrl-C ends it."
                )
                processes.let_be_replaced(_CONTROLLER)
                loss = ""

                def stay() -> bool:
                    """Show what there is to show; never done."""
                    nonlocal loss
                    complaints.show(_COMPLAINTS)
                    if not loss and (loss := processes.endings().get(_CONTROLLER, "")):
                        terminal.CONSOLE.print(f"{loss}: {_REPLACE}", markup=False)
                    return False

                try:
                    operator.wait(stay, "nothing", timeout_s=float("inf"))
                except KeyboardInterrupt:
                    terminal.CONSOLE.print("stopping")
                    if loss:
                        raise LaunchError(loss) from None
                finally:
                    processes.check()
        finally:
            # A node that stops before another one makes that warn.
            complaints.show(_ERRORS)
            if bag and bag.exists():
                terminal.CONSOLE.print(f"recorded in {bag}", markup=False)
                terminal.CONSOLE.print(f"what the nodes printed is in {log}", markup=False)
        if bag and processes.exit_codes()["recorder_node"]:
            raise LaunchError(f"the recording is not complete: flexarm bag repair {bag} -o OTHER")


class _Complaints:
    """The warnings and errors in a growing log, each shown once."""

    def __init__(self, log: Path) -> None:
        self._log = log
        self._read = log.stat().st_size if log.is_file() else 0

    def show(self, levels: tuple[str, ...]) -> None:
        """Show the new ones of these levels."""
        if not self._log.is_file():
            return
        with self._log.open("rb") as log:
            log.seek(self._read)
            # A line that is being written is left to the next time.
            new, newline, _ = log.read().rpartition(b"\n")
        self._read += len(new + newline)
        for line in new.decode(errors="replace").splitlines():
            if any(level in line for level in levels):
                terminal.CONSOLE.print(line, markup=False)

"""Verb up: operation of the graph until Ctrl-C."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import click

from flexarm_bags.metadata import repair_command
from flexarm_bringup.console import terminal
from flexarm_bringup.console.called import as_called
from flexarm_bringup.console.quantity import FREQUENCY_HZ, Quantity
from flexarm_bringup.console.verb_group import examples
from flexarm_bringup.graph.laboratory import LABORATORY, recorded_topics, running_graph
from flexarm_bringup.graph.operator import RunWatch
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.laboratory.live_page import (
    FOXGLOVE,
    FOXGLOVE_NODE,
    PAGE_NODE,
    FoxgloveAddress,
    PageAddress,
    PageSettings,
    foxglove_parameters,
    page_options,
)
from flexarm_bringup.verbs.laboratory.lost_nodes import LostNodes, SetSince
from flexarm_bringup.verbs.laboratory.options import (
    ARM,
    PARAMETER_FILES,
    PAYLOAD,
    REAL_TIME,
    RIG,
    TWIN,
    USUAL_RIG,
    chosen_pace,
    rig_parameter,
    twin_rig,
)
from flexarm_control.laws.registry import LAWS
from flexarm_control.rig_setup import CONTROLLER, SERVO
from flexarm_control.sample_rate import suits
from flexarm_core.channels import is_thesis_arm
from flexarm_core.outputs import require_folder
from flexarm_core.rig_description import SHORT_NAMES, load_rig
from flexarm_live.serving.foxglove_server import require_foxglove

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_bringup.graph.operator import Operator
    from flexarm_bringup.graph.processes import NodeProcesses
    from flexarm_bringup.runs.pace import Pace
    from flexarm_bringup.verbs.laboratory.live_page import Address

_ERRORS = ("[ERROR]", "[FATAL]")
_COMPLAINTS = ("[WARN]", *_ERRORS)
# It commands in open loop, when a page asks for such an experiment.
_IDLE = ("experiment",)
_RATE, _SHAPER_RATE = "rate_hz", "shaper_rate_hz"


@dataclass(frozen=True)
class _Settings:
    """Choices of the user, as the options say them."""

    payload_kg: float
    rate_hz: float
    law: str
    reference: str
    controller: Path | None
    rig: str
    is_thesis: bool
    bag: Path | None
    pace: Pace
    parameter_files: tuple[Path, ...]
    namespace: str
    page: PageSettings | None
    foxglove_port: int | None
    compose: bool | None
    viewer: bool


@click.command()
@PAYLOAD
@click.option(
    "--rate",
    "rate_hz",
    type=Quantity(FREQUENCY_HZ, 10.0, 2000.0),
    metavar="FREQUENCY",
    help="Hz; 300 for the thesis's arm, that of the description for another rig.",
)
@RIG
@TWIN
@click.option(
    "--reference",
    type=click.Choice(["topic", "step", "square", "varying_square"]),
    default="topic",
    show_default=True,
    help="Set-points from the topic `reference`, or a built-in profile.",
)
@click.option("--bag", type=click.Path(path_type=Path), help="Record into this new folder.")
@click.option(
    "--controller",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Law servo with this controller.yaml, which `flexarm design` wrote.",
)
@click.option(
    "--law",
    help=f"Law: {', '.join(LAWS)}; pdpc for the thesis's arm, pd for another rig.",
)
@click.option(
    "--compose/--separate",
    default=None,
    help="Run daq and controller in one process or in two; one for a simulated arm, else two.",
)
@click.option("--viewer", is_flag=True, help="Show an arm in MuJoCo in the engine's own viewer.")
@REAL_TIME
@PARAMETER_FILES
@ARM
@page_options
@FOXGLOVE
@examples(
    "up",
    "up --rate 500 --payload 0.2 --reference square",
    "up --bag out/run1 --law pdpc_plus --params-file out/gains.yaml",
    "up --namespace arm2",
    "up --no-page --foxglove",
    "up --compose --rate 1000 --real-time",
    "up --rig my_arm.yaml",
    "up --twin out/identify/model.yaml",
    "up --rig my_arm.yaml --controller out/design/controller.yaml",
)
def up(
    *,
    real_time: bool,
    rig: str,
    twin: Path | None,
    rate_hz: float | None,
    law: str | None,
    **settings: Any,  # noqa: ANN401
) -> None:
    """Run the nodes of an arm and its page, until Ctrl-C.

    The nodes are daq, controller, recorder and ident, and for the page live and experiment, which
    waits for an experiment in open loop. The address of the page in the browser
    stands on a line of its own: who opens it may command the arm.

    The simulated arm's time follows the wall clock and waits for a machine that is late. A board
    runs in real time.

    A simulated arm shares its process with the controller, which loses fewer samples on a busy
    machine. A board does not: a controller that ends leaves the arm to itself, with the drive at
    zero, and another one may be started in its place. A deactivated controller leaves its place in
    one process as well. When any other node ends, the arm goes on, and the exit code is 1. The end
    of the DAQ node is that of all, and so is a failure of its loop.
    """
    if twin is not None:
        if rig != USUAL_RIG:
            raise click.UsageError("--rig and --twin each name an arm: name one")
        rig = twin_rig(twin)
    description = load_rig(rig)
    is_thesis = is_thesis_arm(description)
    if rig not in SHORT_NAMES and rate_hz not in (None, description.rate_hz):
        raise click.UsageError(f"--rate: {rig} samples at {description.rate_hz:g} Hz by its file")
    if rate_hz is None:
        rate_hz = 300.0 if rig in SHORT_NAMES else description.rate_hz
    chosen = _Settings(
        pace=chosen_pace(real_time=real_time),
        rig=rig,
        is_thesis=is_thesis,
        rate_hz=rate_hz,
        law=_law(law, settings["controller"], is_thesis=is_thesis),
        **settings,
    )
    _run_graph(chosen)


def _law(asked: str | None, controller: Path | None, *, is_thesis: bool) -> str:
    if controller is None:
        return asked or ("pdpc" if is_thesis else "pd")
    if asked not in (None, SERVO):
        raise click.UsageError(f"--controller is one of law {SERVO}, not of {asked}: name one")
    return SERVO


def _run_graph(settings: _Settings) -> None:
    if settings.foxglove_port is not None:
        require_foxglove()
    bag = settings.bag
    if bag and bag.exists():
        raise LaunchError(f"{bag} is there already and is not overwritten: choose another name")
    if bag:
        require_folder(bag.parent, "--bag")
    rig = rig_parameter(settings.rig)
    daq = {
        "payload_kg": settings.payload_kg,
        "rate_hz": settings.rate_hz,
        "viewer": settings.viewer,
    }
    parameters = {
        "daq": daq | settings.pace.parameters() | rig,
        "controller": _controller(settings) | rig,
        "experiment": rig,
        "recorder": {"topics": recorded_topics(is_thesis=settings.is_thesis)},
    }
    nodes: tuple[str, ...] = LABORATORY
    if settings.page is not None:
        nodes = (*_IDLE, *nodes, PAGE_NODE)
        parameters[PAGE_NODE] = settings.page.parameters() | rig
    if settings.foxglove_port is not None:
        nodes = (*nodes, FOXGLOVE_NODE)
        parameters[FOXGLOVE_NODE] = foxglove_parameters(
            settings.foxglove_port, rig.get("rig", USUAL_RIG)
        )
    with TemporaryDirectory(prefix="flexarm_") as folder:
        log = bag.with_name(f"{bag.name}.log") if bag else Path(folder, "nodes.log")
        complaints = _Complaints(log)
        try:
            with running_graph(
                parameters,
                log.absolute(),
                nodes=nodes,
                idle=_IDLE,
                files=settings.parameter_files,
                namespace=settings.namespace,
                compose=settings.compose,
            ) as (operator, processes):
                _start(operator, settings)
                addresses: list[Address] = []
                if settings.page is not None:
                    addresses.append(PageAddress(settings.namespace, processes))
                if settings.foxglove_port is not None:
                    addresses.append(FoxgloveAddress(processes))
                _stay(operator, processes, complaints, addresses, settings)
        finally:
            # A node that stops before another one makes that warn.
            complaints.show(_ERRORS)
            if bag and bag.exists():
                _report_record(bag, log, is_cut=bool(processes.exit_codes()["recorder_node"]))
        if bag and processes.exit_codes()["recorder_node"]:
            raise LaunchError("the recording is not complete")


def _report_record(bag: Path, log: Path, *, is_cut: bool) -> None:
    """Print where the record is, and what the recorder has warned of it."""
    cut = f": its end is missing, try {repair_command(bag)}" if is_cut else ""
    terminal.CONSOLE.print(as_called(f"recorded in {bag}{cut}"))
    said = log.read_text("utf-8", errors="replace") if log.is_file() else ""
    check = f"flexarm bag check {terminal.quoted(bag)}"
    for missing in re.findall(rf"\[WARN\].*: {re.escape(str(bag.absolute()))}: (.*)", said):
        terminal.CONSOLE.print(as_called(f"  {missing}: {check} says where"))
    terminal.CONSOLE.print(f"what the nodes printed is in {log}")


def _controller(settings: _Settings) -> dict[str, Any]:
    """Return parameters of the controller: laws for one rate are made for that of the samples."""
    parameters: dict[str, Any] = {"law": settings.law, "reference": settings.reference}
    if settings.controller is not None:
        parameters[CONTROLLER] = str(settings.controller.absolute())
    if settings.parameter_files or settings.law not in LAWS:
        return parameters
    law = LAWS[settings.law]
    parameters |= _rates(settings.rate_hz, settings.law)
    if any(spec.name == _RATE for spec in law.parameters):
        return parameters
    made_hz = law.rate_hz({})
    if made_hz is not None and not suits(made_hz, settings.rate_hz):
        raise LaunchError(
            f"law {settings.law} is made for {made_hz:g} Hz and --rate is {settings.rate_hz:g} Hz: "
            "sample at that rate, take another law, or one for a model of that rate (--params-file)"
        )
    return parameters


def _rates(rate_hz: float, law: str) -> dict[str, float]:
    """Return the rates that differ from the usual one, of every law that may be set later.

    One that cannot be made for that rate keeps its own, but for the law that is asked for: its
    node refuses it.
    """
    usual_hz = {
        f"{name}.{_RATE}": spec
        for name, each in LAWS.items()
        for spec in each.parameters
        if spec.name == _RATE
        and (name == law or (spec.minimum or 0.0) <= rate_hz <= (spec.maximum or inf))
    }
    changed = {name: rate_hz for name, spec in usual_hz.items() if spec.default != rate_hz}
    return changed | ({_SHAPER_RATE: rate_hz} if changed else {})


def _start(operator: Operator, settings: _Settings) -> None:
    if settings.bag:
        # Not before all nodes have taken their parameters: a refused start shall not leave an
        # empty bag in the way of the next one.
        operator.record(str(settings.bag.absolute()))
    operator.activate("controller")
    operator.start_sampling()
    terminal.CONSOLE.print(
        f"{settings.namespace} is up: {settings.law} at {settings.rate_hz:g} Hz, "
        f"reference: {settings.reference}. Ctrl-C ends it."
    )


def _stay(
    operator: Operator,
    processes: NodeProcesses,
    complaints: _Complaints,
    addresses: Sequence[Address],
    settings: _Settings,
) -> None:
    """Show complaints of the nodes until Ctrl-C; only the end of the DAQ's loop is that of all."""
    since, run = SetSince(operator, "controller"), RunWatch(operator.node)
    run.listen()

    def controller() -> str:
        # Else its first commands might come before the recorder is discovered.
        readers = max(map(operator.node.count_subscribers, ("command", "io_command")))
        files = [f"--params-file {terminal.quoted(each)}" for each in settings.parameter_files]
        start = _controller(settings)
        own = since.words(start)
        if lost := since.lost(start):
            terminal.CONSOLE.print(f"another controller begins with {' and '.join(lost)}")
        return " ".join([f"-p autostart:=true -p listeners:={readers}", *files, own])

    def recorder() -> str:
        topics = recorded_topics(is_thesis=settings.is_thesis)
        return f"-p bag:=NEW_BAG -p 'topics:=[{', '.join(topics)}]'"

    words_of = {"controller_node": controller, "recorder_node": recorder}
    lost = LostNodes(processes, operator.namespace, words_of)

    def look() -> bool:
        """Show the news; never done."""
        if run.has_ended:
            raise LaunchError(f"daq: {run.trouble}")
        complaints.show(_COMPLAINTS)
        for address in addresses:
            address.look()
        lost.look()
        return False

    try:
        operator.wait(look, "", timeout_s=inf)
    except KeyboardInterrupt:
        terminal.CONSOLE.print("stopping")
        lost.check()
    finally:
        processes.check()


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
                terminal.CONSOLE.print(line)

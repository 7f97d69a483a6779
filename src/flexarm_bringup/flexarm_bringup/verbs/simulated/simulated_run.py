"""Way from excitation to a model and a controlled step on the simulated arm, for demo and design.

The closed-loop experiment has the shape of C_dat3 (Table A-3): PD with compensation, 3 V square
wave with half-periods of 2.5 to 5 s, 12000 samples at 300 Hz.
"""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import FORCE
from flexarm_bringup.graph.laboratory import LABORATORY, running_graph
from flexarm_bringup.runs.pace import Pace
from flexarm_bringup.runs.recorded_run import record_run
from flexarm_bringup.verbs.laboratory.live_page import (
    PAGE_NODE,
    PageAddress,
    PageSettings,
    tell_task,
)
from flexarm_bringup.verbs.laboratory.options import ARM, PAYLOAD, paced
from flexarm_bringup.verbs.simulated.step_results import SET_POINT_V, ControlledStep, show_model
from flexarm_core.outputs import MARK, OutputError, is_replaceable, require_place
from flexarm_daq.experiments.catalogue import experiment
from flexarm_ident.job import result_files

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from flexarm_bringup.graph.operator import Operator
    from flexarm_bringup.runs.recorded_run import RecordedRun
    from flexarm_msgs.srv import Identify

SUMMARY_FILE = "summary.json"
REPORT_FILE = "report.html"
BAG_FOLDER = "bag"
MODELS_FOLDER = "models"
# A reply takes about that long over DDS.
REPLY_DELAY_S = 6e-4
_STEP_SAMPLES = 3000
_EXPERIMENT = "experiment"
_LEFT_OVER = ".flexarm"


@dataclass(frozen=True)
class RunSettings:
    """Choices of the user.

    `keep_bag` keeps the bags in the folder of the results, `force` replaces what somebody else or
    an earlier `keep_bag` left there. `live` serves a page that looks on.
    """

    out: Path
    payload_kg: float
    seed: int
    pace: Pace
    keep_bag: bool
    force: bool
    live: bool
    namespace: str


def run_options(function: Callable[..., None]) -> Callable[..., None]:
    """Add the options of `RunSettings` to a verb, but for the folder."""
    options = (
        PAYLOAD,
        click.option(
            "--seed",
            type=click.IntRange(0),
            default=1,
            show_default=True,
            help="Seed of the noise.",
        ),
        paced,
        click.option("--keep-bag", is_flag=True, help="Keep the recorded bags in OUT/bag."),
        click.option(
            "--live",
            is_flag=True,
            help="Show every step on a page in the browser, whose address stands on a line.",
        ),
        FORCE,
        ARM,
    )
    for option in reversed(options):
        function = option(function)
    return function


class SimulatedRun:
    """Running laboratory with the simulated arm.

    Attributes
    ----------
    operator : Operator
        Operator of the graph.
    bags : Path
        Folder of the bags.
    """

    def __init__(self, operator: Operator, bags: Path, settings: RunSettings) -> None:
        self.operator = operator
        self.bags = bags
        self._settings = settings

    def begin(self, words: str) -> None:
        """Tell the user what comes next, on the page too."""
        terminal.step(words)
        if self._settings.live:
            tell_task(self._settings.namespace, words)

    def excite(self) -> RecordedRun:
        """Record the closed-loop experiment."""
        entry, settings = experiment("C_dat3"), self._settings
        pace = "as fast as it goes" if settings.pace is Pace.FAST else f"{entry.length_s:.0f} s"
        self.begin(
            f"Closed-loop experiment, {settings.payload_kg * 1e3:.0f} g payload: "
            f"{entry.samples} samples at {entry.rate_hz:.0f} Hz, {pace}"
        )
        bag = self.bags / _EXPERIMENT
        text = "exciting the arm"
        return record_run(self.operator, "controller", bag, entry.samples, text=text)

    def identify(self, request: Identify.Request) -> Identify.Response:
        """Identify a model from the experiment and print it."""
        request.bag_uris = [str(self.bags / _EXPERIMENT)]
        with terminal.busy("subspace identification of the recorded bag"):
            response = self.operator.identify(request)
        show_model(response)
        return response

    def step(self, name: str, law: Mapping[str, Any]) -> ControlledStep:
        """Record a step to 3 V with a law, its parameters as those of the controller node."""
        reference = {"reference": "step", "step.amplitude_v": SET_POINT_V}
        self.operator.set_parameters("controller", {**law, **reference})
        return ControlledStep.of(
            record_run(
                self.operator, "controller", self.bags / name, _STEP_SAMPLES, text="stepping"
            )
        )


@contextmanager
def simulated_run(settings: RunSettings) -> Iterator[SimulatedRun]:
    """Make room for the results and run the nodes.

    Raises
    ------
    OutputError
        When a result would replace something of somebody else.
    LaunchError
        When a node does not do its part.
    """
    _make_room(settings)
    settings.pace.prepare()
    out, parameters = settings.out, _start_parameters(settings)
    with _bag_folder(out / BAG_FOLDER, keep=settings.keep_bag) as bags:
        nodes = (*LABORATORY, PAGE_NODE) if settings.live else LABORATORY
        terminal.step(f"Starting the nodes: {', '.join(reversed(nodes))}")
        with running_graph(
            parameters, out / "nodes.log", nodes=nodes, namespace=settings.namespace
        ) as (operator, processes):
            if settings.live:
                page = PageAddress(settings.namespace, processes)
                operator.wait(page.look, "the page")
            yield SimulatedRun(operator, bags, settings)


def told_results(settings: RunSettings) -> str:
    """Return where the results are, for the user."""
    out = settings.out
    kept = str(out / BAG_FOLDER) if settings.keep_bag else "removed, --keep-bag keeps them"
    return f"Report: {out / REPORT_FILE}. Bags: {kept}"


def _make_room(settings: RunSettings) -> None:
    """Refuse, before any work, to replace what somebody else or `--keep-bag` left in the folder."""
    out, force = settings.out, settings.force
    models = result_files(out / MODELS_FOLDER / _EXPERIMENT, ())
    require_place([out / SUMMARY_FILE, out / REPORT_FILE, *models], force=force)
    bags = out / BAG_FOLDER
    is_left_over = (bags / _LEFT_OVER).is_file() and is_replaceable(bags / _LEFT_OVER)
    if bags.exists() and not (force or is_left_over):
        raise OutputError(
            f"{bags}: holds bags that were kept, or something else: move it away, choose another "
            "--out, or replace it with --force"
        )


@contextmanager
def _bag_folder(folder: Path, *, keep: bool) -> Iterator[Path]:
    """Give an empty folder for bags; remove it at the end, whatever the end is, unless kept."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    if not keep:
        # A run that is killed leaves the folder: the next one may remove it.
        (folder / _LEFT_OVER).write_text(f"{MARK}\n", "utf-8")
    try:
        yield folder.absolute()
    finally:
        if not keep:
            shutil.rmtree(folder, ignore_errors=True)


def _start_parameters(settings: RunSettings) -> dict[str, dict[str, Any]]:
    entry = experiment("C_dat3")
    return {
        "daq": {
            "rate_hz": float(entry.rate_hz),
            "payload_kg": settings.payload_kg,
            "seed": settings.seed,
            "reply_delay_s": REPLY_DELAY_S,
            **settings.pace.parameters(),
        },
        "controller": entry.commander_parameters(settings.seed),
        "ident": {
            "output_folder": str((settings.out / MODELS_FOLDER).absolute()),
            "force": settings.force,
        },
        PAGE_NODE: PageSettings(port=0, view_only=True).parameters(),
    }

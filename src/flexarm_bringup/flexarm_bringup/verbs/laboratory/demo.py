"""Verb demo: excite, record, identify, reduce and control the simulated arm once.

The closed-loop experiment has the shape of C_dat3 (Table A-3): PD with compensation, 3 V square
wave with half-periods of 2.5 to 5 s, 12000 samples at 300 Hz.
"""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import FORCE, examples
from flexarm_bringup.graph.laboratory import running_graph
from flexarm_bringup.runs.pace import Pace
from flexarm_bringup.runs.recorded_run import record_run
from flexarm_bringup.verbs.laboratory.demo_results import (
    BAG_FOLDER,
    REPORT_FILE,
    SET_POINT_V,
    SUMMARY_FILE,
    DemoResults,
    DemoSettings,
    show_model,
    write_results,
)
from flexarm_bringup.verbs.laboratory.options import ARM, PAYLOAD, paced
from flexarm_core.outputs import MARK, OutputError, is_replaceable, require_place
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_ident.job import result_files
from flexarm_msgs.srv import Identify

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

RATE_HZ = 300.0
EXPERIMENT_SAMPLES = 12000
STEP_SAMPLES = 3000
REDUCED_ORDER = 10
# A reply takes about that long over DDS.
REPLY_DELAY_S = 6e-4
MODELS_FOLDER = "models"
_EXPERIMENT = "experiment"
_LEFT_OVER = ".flexarm"


@click.command()
@PAYLOAD
@click.option(
    "--seed", type=click.IntRange(0), default=1, show_default=True, help="Seed of the noise."
)
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/demo"), show_default=True)
@paced
@click.option("--keep-bag", is_flag=True, help="Keep the recorded bags in OUT/bag.")
@FORCE
@ARM
@examples(
    "demo",
    "demo --fast --payload 0.4 --seed 7",
    "demo --out /tmp/arm --keep-bag",
    "demo --real-time",
)
def demo(**settings: Any) -> None:  # noqa: ANN401
    """Excite, identify and control the simulated arm.

    The arm's time follows the wall clock and waits for a machine that is late: no sample is lost.
    """
    _run_demo(DemoSettings(**settings))


def _run_demo(settings: DemoSettings) -> None:
    out = settings.out
    _make_room(settings)
    true_modes_hz = natural_frequencies_hz(RigParameters(payload_kg=settings.payload_kg)).tolist()
    settings.pace.prepare()
    with _bag_folder(out / BAG_FOLDER, keep=settings.keep_bag) as bags:
        terminal.step("Starting the nodes: daq, controller, recorder, ident")
        parameters, log = _start_parameters(settings), out / "nodes.log"
        with running_graph(parameters, log, namespace=settings.namespace) as (operator, _):
            terminal.step(_experiment_text(settings))
            bag = bags / _EXPERIMENT
            experiment = record_run(
                operator, "controller", bag, EXPERIMENT_SAMPLES, text="exciting the arm"
            )
            terminal.step("Identifying, reducing and validating a model")
            with terminal.busy("subspace identification of the recorded bag"):
                response = operator.identify(_request(bag, true_modes_hz))
            show_model(response)
            terminal.step(f"Controlling the arm: PDPC, step to {SET_POINT_V:g} V")
            step = {"law": "pdpc", "reference": "step", "step.amplitude_v": SET_POINT_V}
            operator.set_parameters("controller", step)
            controlled = record_run(
                operator, "controller", bags / "step", STEP_SAMPLES, text="stepping"
            )
    write_results(settings, DemoResults(experiment, response, controlled, true_modes_hz))


def _make_room(settings: DemoSettings) -> None:
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


def _start_parameters(settings: DemoSettings) -> dict[str, dict[str, Any]]:
    return {
        "daq": {
            "rate_hz": RATE_HZ,
            "payload_kg": settings.payload_kg,
            "seed": settings.seed,
            "reply_delay_s": REPLY_DELAY_S,
            **settings.pace.parameters(),
        },
        "controller": {
            "law": "pd",
            "pd.compensation_v": 0.7,
            "reference": "varying_square",
            "varying_square.amplitude_v": SET_POINT_V,
            "varying_square.shortest_s": 2.5,
            "varying_square.longest_s": 5.0,
            "varying_square.seed": settings.seed,
        },
        "ident": {
            "output_folder": str((settings.out / MODELS_FOLDER).absolute()),
            "force": settings.force,
        },
    }


def _experiment_text(settings: DemoSettings) -> str:
    seconds = EXPERIMENT_SAMPLES / RATE_HZ
    pace = "as fast as it goes" if settings.pace is Pace.FAST else f"{seconds:.0f} s"
    return (
        f"Closed-loop experiment, {settings.payload_kg * 1e3:.0f} g payload: "
        f"{EXPERIMENT_SAMPLES} samples at {RATE_HZ:.0f} Hz, {pace}"
    )


def _request(bag: Path, known_modes_hz: Sequence[float]) -> Identify.Request:
    return Identify.Request(
        bag_uris=[str(bag)],
        # The other half shows what the model does with data it has not seen.
        train_fraction=0.5,
        method="auto",
        reduction="mrmc",
        reduced_order=REDUCED_ORDER,
        known_modes_hz=list(known_modes_hz),
        update="b",
        remove_compensation=True,
        stabilise=True,
        friction=True,
    )

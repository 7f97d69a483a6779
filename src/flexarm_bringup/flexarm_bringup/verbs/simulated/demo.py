"""Verb demo: excite, record, identify, reduce and control the simulated arm once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import examples
from flexarm_bringup.verbs.simulated.chosen_run import simulated_run
from flexarm_bringup.verbs.simulated.demo_results import DemoResults, write_results
from flexarm_bringup.verbs.simulated.run_settings import RunSettings, run_options
from flexarm_bringup.verbs.simulated.step_results import SET_POINT_V
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_ident.workflow.request import Request

if TYPE_CHECKING:
    from collections.abc import Sequence

REDUCED_ORDER = 10
# The move is over in less than a second; the figures have a mean over the last two.
_PLANNED_S = 3.0


@click.command()
@click.option(
    "-o", "--out", type=click.Path(path_type=Path), default=Path("out/demo"), show_default=True
)
@run_options
@examples(
    "demo",
    "demo --fast --payload 0.4 --seed 7",
    "demo -o /tmp/arm --keep-bag",
    "demo --live",
    "demo --real-time",
)
def demo(**settings: Any) -> None:  # noqa: ANN401
    """Excite, identify and control the simulated arm.

    The arm's time follows the wall clock and waits for a machine that is late: no sample is lost.
    """
    _run_demo(RunSettings(**settings))


def _run_demo(settings: RunSettings) -> None:
    true_modes_hz = natural_frequencies_hz(RigParameters(payload_kg=settings.payload_kg)).tolist()
    with simulated_run(settings) as run:
        experiment = run.excite()
        run.begin("Identifying a model from the first half of the record, validating it on all")
        identified = run.begin_identify(_request(true_modes_hz))
        run.begin(f"Controlling the arm: PDPC, step to {SET_POINT_V:g} V")
        step = run.step("step", {"law": "pdpc"})
        run.begin(f"Moving the arm as planned: step to {SET_POINT_V:g} V")
        law = {"law": "planned", "planned.payload_kg": settings.payload_kg}
        planned = run.step("planned", law, length_s=_PLANNED_S)
        run.end_runs()
        model = identified()
    write_results(settings, DemoResults(experiment, model, step, planned, true_modes_hz))
    terminal.next_step(run.followed_by)


def _request(known_modes_hz: Sequence[float]) -> Request:
    return Request(
        # The other half shows what the model does with data it has not seen.
        train_fraction=0.5,
        reduction="mrmc",
        reduced_order=REDUCED_ORDER,
        known_modes_hz=tuple(known_modes_hz),
        update="b",
    )

"""Verb demo: excite, record, identify, reduce and control the simulated arm once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import examples
from flexarm_bringup.runs.pace import Pace
from flexarm_bringup.verbs.simulated.chosen_run import simulated_run
from flexarm_bringup.verbs.simulated.simulated_run import (
    REPORT_FILE,
    SET_POINT_V,
    SUMMARY_FILE,
    RunSettings,
    run_options,
    versions,
)
from flexarm_core.outputs import write_facts
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_ident.provenance import samples_hash
from flexarm_ident.report.page import append_section
from flexarm_ident.workflow.request import Request

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_bringup.runs.recorded_run import RecordedRun
    from flexarm_bringup.verbs.simulated.simulated_run import ControlledStep, IdentifiedModel

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


@dataclass(frozen=True)
class DemoResults:
    """Records and model of a demo: the closed-loop experiment, both controlled steps."""

    experiment: RecordedRun
    model: IdentifiedModel
    step: ControlledStep
    planned: ControlledStep
    true_modes_hz: Sequence[float]


def write_results(settings: RunSettings, results: DemoResults) -> None:
    """Write `summary.json` and `report.html`, and print the figures of the steps."""
    out, step, planned = settings.out, results.step, results.planned
    report = (results.model.folder / REPORT_FILE).read_text(encoding="utf-8")
    blocks = (
        *step.blocks("PDPC (4-6 to 4-8) with the packaged gains"),
        *planned.blocks("Law planned with the figures of the payload"),
    )
    (out / REPORT_FILE).write_text(append_section(report, "Controlled step", blocks), "utf-8")
    write_facts(out / SUMMARY_FILE, _summary(settings, results))
    terminal.CONSOLE.print(f"  PDPC: {step.text}")
    terminal.CONSOLE.print(f"  planned: {planned.text}")
    terminal.step(settings.results_text())


def _summary(settings: RunSettings, results: DemoResults) -> dict[str, Any]:
    model, experiment = results.model, results.experiment
    facts = model.facts
    both = (experiment, results.step.recorded)
    planned = results.planned.recorded
    return {
        "payload_kg": settings.payload_kg,
        "seed": settings.seed,
        "time": "real" if settings.pace is Pace.REAL else "virtual",
        "real_time_factor": experiment.run.real_time_factor,
        "samples": experiment.reading.samples,
        "lost": sum(each.reading.lost for each in (*both, planned)),
        "missed_periods": sum(each.run.missed for each in (*both, planned)),
        "sha256_of_samples": [samples_hash(each.reading.data) for each in both],
        "full_order": model.order,
        "reduced_order": model.reduced_order,
        "modes_hz": model.kept_modes_hz(results.true_modes_hz),
        "true_modes_hz": list(results.true_modes_hz),
        "dmv": list(facts.dmv[:-1]),
        "dmv_mean": facts.dmv[-1],
        "sfv": list(facts.sfv[:-1]),
        "sfv_mean": facts.sfv[-1] if facts.sfv else None,
        "warnings": list(facts.warnings),
        "pdpc": results.step.summary(),
        "planned": {
            **results.planned.summary(),
            "sha256_of_samples": samples_hash(planned.reading.data),
        },
        "versions": versions(),
    }

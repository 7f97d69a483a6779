"""Results of the demo: a summary, a report with the controlled step, lines on the terminal."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flexarm_bringup.console import terminal
from flexarm_bringup.runs.pace import Pace
from flexarm_bringup.verbs.simulated.run_settings import REPORT_FILE, SUMMARY_FILE
from flexarm_bringup.verbs.simulated.step_results import versions
from flexarm_core.outputs import MARK_KEY
from flexarm_ident.provenance import samples_hash
from flexarm_ident.report.page import append_section

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_bringup.runs.recorded_run import RecordedRun
    from flexarm_bringup.verbs.simulated.identified_model import IdentifiedModel
    from flexarm_bringup.verbs.simulated.run_settings import RunSettings
    from flexarm_bringup.verbs.simulated.step_results import ControlledStep


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
    summary = _summary(settings, results)
    (out / SUMMARY_FILE).write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    terminal.CONSOLE.print(f"  PDPC: {step.text}")
    terminal.CONSOLE.print(f"  planned: {planned.text}")
    terminal.step(settings.told_results())


def _summary(settings: RunSettings, results: DemoResults) -> dict[str, Any]:
    model, experiment = results.model, results.experiment
    both = (experiment, results.step.recorded)
    planned = results.planned.recorded
    return {
        **MARK_KEY,
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
        "dmv": list(model.dmv[:-1]),
        "dmv_mean": model.dmv[-1],
        "sfv": list(model.sfv[:-1]),
        "sfv_mean": model.sfv[-1] if model.sfv else None,
        "warnings": list(model.warnings),
        "pdpc": results.step.summary(),
        "planned": {
            **results.planned.summary(),
            "sha256_of_samples": samples_hash(planned.reading.data),
        },
        "versions": versions(),
    }

"""Results of the demo: a summary, a report with the controlled step, lines on the terminal."""

from __future__ import annotations

import json
import math
import os
import platform
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rclpy.parameter import Parameter

from flexarm_bringup.console import terminal
from flexarm_bringup.runs.pace import Pace
from flexarm_control.design.criteria import step_figures
from flexarm_core.outputs import MARK_KEY
from flexarm_ident.provenance import samples_hash
from flexarm_ident.records.iodata import ARM_OUTPUTS
from flexarm_ident.report.content.blocks import Plots, Words
from flexarm_ident.report.page import append_section
from flexarm_ident.report.plots.time_plots import step_plot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_bringup.runs.recorded_run import RecordedRun
    from flexarm_control.design.criteria import StepFigures
    from flexarm_ident.records.iodata import IoData
    from flexarm_msgs.msg import ModeSummary
    from flexarm_msgs.srv import Identify

SET_POINT_V = 3.0
SUMMARY_FILE = "summary.json"
REPORT_FILE = "report.html"
BAG_FOLDER = "bag"
VERSIONED = ("flexarm_bringup", "numpy", "scipy", "control", "numba", "rosbags", "mcap")


@dataclass(frozen=True)
class DemoSettings:
    """Choices of the user.

    `keep_bag` keeps the two bags in the folder of the results, `force` replaces what somebody else
    or an earlier `keep_bag` left there.
    """

    out: Path
    payload_kg: float
    seed: int
    pace: Pace
    keep_bag: bool
    force: bool
    namespace: str


@dataclass(frozen=True)
class DemoResults:
    """Records and model of a demo: the closed-loop experiment and the controlled step."""

    experiment: RecordedRun
    response: Identify.Response
    step: RecordedRun
    true_modes_hz: Sequence[float]


def show_model(response: Identify.Response) -> None:
    """Print modes, errors and warnings of the identified model."""
    terminal.CONSOLE.print(f"  {response.message}")
    parameters = {
        each.name: Parameter.from_parameter_msg(each).value for each in response.parameters
    }
    terminal.show_model(
        terminal.ShownModel(
            modes=response.modes,
            outputs=ARM_OUTPUTS,
            dmv=response.dmv,
            left_out=response.left_out,
            sfv=response.sfv,
            parameters=parameters,
            warnings=response.warnings,
        )
    )


def write_results(settings: DemoSettings, results: DemoResults) -> None:
    """Write `summary.json` and `report.html`, and print the figures of the step."""
    out, step = settings.out, results.step.reading.data
    time_s = np.arange(len(step), dtype=np.float64) * step.dt_s
    figures = step_figures(time_s, step.y[:, 0], SET_POINT_V)
    summary = _summary(settings, results, figures)
    blocks = _step_blocks(time_s, step, figures)
    report = Path(results.response.report_path, "report.html").read_text(encoding="utf-8")
    longer = append_section(report, "Controlled step", blocks)
    (out / REPORT_FILE).write_text(longer, encoding="utf-8")
    (out / SUMMARY_FILE).write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    settled = f"{figures.settling_s:.2f} s" if math.isfinite(figures.settling_s) else "-"
    terminal.CONSOLE.print(
        f"  mean error over the last 2 s {figures.mean_error_v:+.4f} V, "
        f"overshoot {100 * figures.overshoot:.1f} %, settled after {settled}"
    )
    kept = str(out / BAG_FOLDER) if settings.keep_bag else "removed, --keep-bag keeps them"
    terminal.step(f"Report: {out / REPORT_FILE}. Bags: {kept}")


def _summary(settings: DemoSettings, results: DemoResults, figures: StepFigures) -> dict[str, Any]:
    response, experiment = results.response, results.experiment
    both = (experiment, results.step)
    return {
        **MARK_KEY,
        "payload_kg": settings.payload_kg,
        "seed": settings.seed,
        "time": "real" if settings.pace is Pace.REAL else "virtual",
        "real_time_factor": experiment.run.real_time_factor,
        "samples": experiment.reading.samples,
        "lost": sum(each.reading.lost for each in both),
        "missed_periods": sum(each.run.missed for each in both),
        "sha256_of_samples": [samples_hash(each.reading.data) for each in both],
        "full_order": sum(_states(mode) for mode in response.modes),
        "reduced_order": sum(_states(mode) for mode in response.modes if mode.kept),
        "modes_hz": _kept_modes_hz(response, results.true_modes_hz),
        "true_modes_hz": list(results.true_modes_hz),
        "dmv": list(response.dmv[:-1]),
        "dmv_mean": response.dmv[-1],
        "sfv": list(response.sfv[:-1]),
        "sfv_mean": response.sfv[-1] if response.sfv else None,
        "warnings": list(response.warnings),
        "pdpc": {
            "set_point_v": SET_POINT_V,
            "mean_error_v": figures.mean_error_v,
            "overshoot": figures.overshoot,
            "settling_s": figures.settling_s if math.isfinite(figures.settling_s) else None,
        },
        "versions": {
            "python": platform.python_version(),
            "ros_distro": os.environ.get("ROS_DISTRO", "unknown"),
            **{name: version(name) for name in VERSIONED},
        },
    }


def _states(mode: ModeSummary) -> int:
    """Return the states of a mode: two of a complex pair, one of a real eigenvalue."""
    return 2 if mode.eigenvalue_imaginary > 0.0 else 1


def _kept_modes_hz(response: Identify.Response, known_modes_hz: Sequence[float]) -> list[float]:
    """Return the reduced model's flexible modes, one for each known one; none if it has no pair."""
    pairs = [mode for mode in response.modes if mode.kept and mode.eigenvalue_imaginary > 0.0]
    if not pairs:
        return []
    return [
        min(pairs, key=lambda mode: abs(math.log(mode.frequency_hz / known))).frequency_hz
        for known in known_modes_hz
    ]


def _step_blocks(
    time_s: NDArray[np.float64], step: IoData, figures: StepFigures
) -> tuple[Words, Plots]:
    """Return the section of the report on the controlled step."""
    words = (
        f"PDPC (4-6 to 4-8) with the thesis's gains, step to {SET_POINT_V:g} V. "
        f"Mean error over the last 2 s {figures.mean_error_v:+.4f} V, "
        f"overshoot {100 * figures.overshoot:.1f} %, "
        f"within 5 % after {figures.settling_s:.2f} s."
    )
    set_point_v = np.full(len(step), SET_POINT_V)
    plot = step_plot(time_s, step.y, set_point_v, step.u[:, 0])
    return Words(words), Plots((("", plot),))

"""The whole loop once: excite, record, identify, reduce, control, report.

The closed-loop experiment has the shape of C_dat3 (Table A-3): PD with compensation, 3 V square
wave with half-periods of 2.5 to 5 s, 12000 samples at 300 Hz.
"""

from __future__ import annotations

import json
import math
import os
import platform
import shutil
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rclpy.parameter import Parameter

from flexarm_bringup.console import terminal
from flexarm_bringup.graph.laboratory import running_graph
from flexarm_bringup.runs.pace import Pace, in_lockstep, pace_text
from flexarm_bringup.runs.run_record import require_whole, samples_hash
from flexarm_control.design.criteria import step_figures
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_ident.reading.read import read_bag_report
from flexarm_ident.records.iodata import ARM_OUTPUTS
from flexarm_ident.report.content.blocks import Plots, Words
from flexarm_ident.report.page import append_section
from flexarm_ident.report.plots.time_plots import step_plot
from flexarm_msgs.srv import Identify

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_bringup.graph.operation import Operator, Run
    from flexarm_control.design.criteria import StepFigures
    from flexarm_ident.reading.alignment import BagReading

RATE_HZ = 300.0
EXPERIMENT_SAMPLES = 12000
STEP_SAMPLES = 3000
SET_POINT_V = 3.0
REDUCED_ORDER = 10
VERSIONED = ("flexarm_bringup", "numpy", "scipy", "control", "numba", "rosbags", "mcap")
# A reply takes about that long over DDS.
REPLY_DELAY_S = 6e-4


@dataclass(frozen=True)
class DemoSettings:
    """What a user can choose.

    Attributes
    ----------
    out
        Folder of the results.
    payload_kg
        Mass at the tip of the simulated arm.
    seed
        Seed of the sensor noise and of the reference's half-periods.
    pace
        Wall clock, fast or hard real time.
    keep_bag
        Keep the two bags in the folder of the results.
    """

    out: Path
    payload_kg: float = 0.0
    seed: int = 1
    pace: Pace = Pace.WALL_CLOCK
    keep_bag: bool = False


class Recording(NamedTuple):
    """A run and its record."""

    run: Run
    reading: BagReading


def run_demo(settings: DemoSettings) -> dict[str, Any]:
    """Run the demo and return its summary, which is also written to `summary.json`.

    Raises
    ------
    LaunchError
        When a node does not do its part, or a record is not whole.
    """
    out = settings.out
    out.mkdir(parents=True, exist_ok=True)
    log = out / "nodes.log"
    log.unlink(missing_ok=True)
    true_modes_hz = natural_frequencies_hz(RigParameters(payload_kg=settings.payload_kg))
    settings.pace.prepare()
    with _bag_folder(out / "bag", keep=settings.keep_bag) as bags:
        terminal.step("Starting the nodes: daq, controller, recorder, ident")
        with running_graph(_start_parameters(settings), log) as (operator, _):
            terminal.step(_experiment_text(settings))
            experiment = _record(
                operator, bags / "experiment", EXPERIMENT_SAMPLES, "exciting the arm"
            )
            terminal.step("Identifying, reducing and validating a model")
            with terminal.busy("subspace identification of the recorded bag"):
                response = operator.identify(_request(bags / "experiment", true_modes_hz))
            terminal.CONSOLE.print(f"  {response.message}")
            terminal.show_model(_shown(response))
            terminal.step(f"Controlling the arm: PDPC, step to {SET_POINT_V:g} V")
            operator.set_parameters(
                "controller",
                {"law": "pdpc", "reference": "step", "step.amplitude_v": SET_POINT_V},
            )
            step = _record(operator, bags / "step", STEP_SAMPLES, "stepping")
    summary = _summary(settings, response, experiment, step, true_modes_hz)
    _write_report(out, response, step.reading)
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    _show_step(summary, out, keep_bag=settings.keep_bag)
    return summary


@contextmanager
def _bag_folder(folder: Path, *, keep: bool) -> Iterator[Path]:
    """Give an empty folder for bags; remove it at the end, whatever the end is, unless kept."""
    shutil.rmtree(folder, ignore_errors=True)
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
        "ident": {"output_folder": str((settings.out / "models").absolute())},
    }


def _experiment_text(settings: DemoSettings) -> str:
    seconds = EXPERIMENT_SAMPLES / RATE_HZ
    pace = "as fast as it goes" if settings.pace is Pace.FAST else f"{seconds:.0f} s"
    return (
        f"Closed-loop experiment, {settings.payload_kg * 1e3:.0f} g payload: "
        f"{EXPERIMENT_SAMPLES} samples at {RATE_HZ:.0f} Hz, {pace}"
    )


def _record(operator: Operator, bag: Path, samples: int, text: str) -> Recording:
    with terminal.progress_bar(text, samples) as progress:
        run = operator.recorded_run("controller", str(bag), samples, progress)
    terminal.CONSOLE.print(f"  recorded {run.recorded}")
    terminal.CONSOLE.print(f"  {pace_text(run)}")
    reading = read_bag_report(bag)
    require_whole(reading, run.taken, lockstep=in_lockstep(operator))
    return Recording(run, reading)


def _request(bag: Path, known_modes_hz: np.ndarray) -> Identify.Request:
    return Identify.Request(
        bag_uris=[str(bag)],
        train_fraction=0.5,
        method="auto",
        reduction="mrmc",
        reduced_order=REDUCED_ORDER,
        known_modes_hz=known_modes_hz.tolist(),
        update="b",
        remove_compensation=True,
        stabilise=True,
        friction=True,
    )


def _shown(response: Identify.Response) -> terminal.ShownModel:
    parameters = {
        each.name: Parameter.from_parameter_msg(each).value for each in response.parameters
    }
    return terminal.ShownModel(
        response.modes, ARM_OUTPUTS, response.dmv, response.sfv, parameters, response.warnings
    )


def _figures(step: BagReading) -> StepFigures:
    time_s = np.arange(len(step.data)) * step.data.dt_s
    return step_figures(time_s, step.data.y[:, 0], SET_POINT_V)


def _kept_modes_hz(response: Identify.Response, known_modes_hz: np.ndarray) -> list[float]:
    """Return the reduced model's flexible modes, one for each known one; none if it has no pair."""
    pairs = [mode for mode in response.modes if mode.kept and mode.eigenvalue_imaginary > 0.0]
    if not pairs:
        return []
    return [
        min(pairs, key=lambda mode: abs(math.log(mode.frequency_hz / known))).frequency_hz
        for known in known_modes_hz
    ]


def _summary(
    settings: DemoSettings,
    response: Identify.Response,
    experiment: Recording,
    step: Recording,
    true_modes_hz: np.ndarray,
) -> dict[str, Any]:
    figures = _figures(step.reading)
    both = (experiment, step)
    return {
        "payload_kg": settings.payload_kg,
        "seed": settings.seed,
        "time": "real" if settings.pace is Pace.REAL else "virtual",
        "real_time_factor": experiment.run.real_time_factor,
        "samples": experiment.reading.samples,
        "lost": sum(each.reading.lost for each in both),
        "missed_periods": sum(each.run.missed for each in both),
        "sha256_of_samples": [samples_hash(each.reading.data) for each in both],
        "full_order": sum(1 + (mode.eigenvalue_imaginary > 0.0) for mode in response.modes),
        "reduced_order": sum(
            1 + (mode.eigenvalue_imaginary > 0.0) for mode in response.modes if mode.kept
        ),
        "modes_hz": _kept_modes_hz(response, true_modes_hz),
        "true_modes_hz": true_modes_hz.tolist(),
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


def _write_report(out: Path, response: Identify.Response, step: BagReading) -> None:
    """Write the service's report with the controlled step added."""
    figures = _figures(step)
    text = Path(response.report_path, "report.html").read_text(encoding="utf-8")
    data = step.data
    time_s = np.arange(len(data), dtype=np.float64) * data.dt_s
    set_point_v = np.full(len(data), SET_POINT_V)
    plot = step_plot(time_s, data.y, set_point_v, data.u[:, 0])
    words = (
        f"PDPC (4-6 to 4-8) with the thesis's gains, step to {SET_POINT_V:g} V. "
        f"Mean error over the last 2 s {figures.mean_error_v:+.4f} V, "
        f"overshoot {100 * figures.overshoot:.1f} %, "
        f"within 5 % after {figures.settling_s:.2f} s."
    )
    blocks = (Words(words), Plots((("", plot),)))
    longer = append_section(text, "Controlled step", blocks)
    (out / "report.html").write_text(longer, encoding="utf-8")


def _show_step(summary: dict[str, Any], out: Path, *, keep_bag: bool) -> None:
    pdpc = summary["pdpc"]
    settling = pdpc["settling_s"]
    terminal.CONSOLE.print(
        f"  mean error over the last 2 s {pdpc['mean_error_v']:+.4f} V, "
        f"overshoot {100 * pdpc['overshoot']:.1f} %, settled after "
        + ("-" if settling is None else f"{settling:.2f} s")
    )
    kept = f"Bags: {out / 'bag'}" if keep_bag else "Bags: removed, --keep-bag keeps them"
    terminal.step(f"Report: {out / 'report.html'}. {kept}")

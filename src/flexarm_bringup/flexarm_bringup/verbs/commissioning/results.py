"""Results of a commissioning: its summary, its report, and the controller."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.commissioning.answers import Friction
from flexarm_control.servo.report import step_figures, summary, summary_lines
from flexarm_core.labels import axis_label
from flexarm_core.outputs import MARK_KEY, write_facts
from flexarm_ident.report.content.blocks import Links, Plots, Table, Words
from flexarm_ident.report.content.wording import sentence
from flexarm_ident.report.page import render_page
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.chart import Panel, View, chart
from flexarm_ident.report.plots.marks import Axis

if TYPE_CHECKING:
    from flexarm_bringup.verbs.commissioning.commissioner import State, Steps
    from flexarm_control.servo.job import ServoDesign
    from flexarm_core.rig_description import RigDescription
    from flexarm_ident.job import Results
    from flexarm_ident.report.content.blocks import Block


def write_results(
    rig: RigDescription,
    state: State,
    results: Results,
    design: ServoDesign,
    steps: Steps,
) -> None:
    """Write ``controller.yaml``, ``summary.json`` and ``report.html`` into the folder.

    Parameters
    ----------
    rig : RigDescription
        The arm.
    state : State
        What the stages found, and the folder, with the design in ``servo``.
    results : Results
        The model.
    design : ServoDesign
        The controller.
    steps : Steps
        Its steps on the arm.
    """
    out = state.folder
    shutil.copyfile(out / "servo" / "controller.yaml", out / "controller.yaml")
    found = {
        "rig": rig.name,
        "verdict": str(results.outcome.verdict.level),
        "model": str(results.folder.relative_to(out)),
        "stages": state.found,
        "servo": {key: value for key, value in summary(design).items() if key not in MARK_KEY},
        "step": [
            {
                "output": mine.output,
                "size": float(size),
                "arm": step_figures(mine),
                "predicted": step_figures(other),
            }
            for size, mine, other in zip(steps.steps, steps.results, steps.predicted, strict=True)
        ],
    }
    write_facts(out / "summary.json", found)
    (out / "report.html").write_text(_report(rig, state, results, design, steps), "utf-8")


def _report(
    rig: RigDescription, state: State, results: Results, design: ServoDesign, steps: Steps
) -> str:
    out = state.folder
    pulses, friction = state.found["pulses"], state.found["friction"]
    rows = []
    for joint, pulse, level in zip(rig.joints, pulses, friction, strict=True):
        driven, angle = rig.input(joint.input).unit, rig.output(joint.angle).unit
        rows.append(
            (
                joint.name,
                f"{pulse['height']:.3g} {driven}",
                f"{pulse['gain']:.3g} {angle}/s² for 1 {driven}",
                f"{Friction(**level).text} {driven}",
                f"{level['offset']:+.2g} {driven}",
            )
        )
    head = ("joint", "moves at a pulse of", "acceleration, at least", "dry friction", "offset")
    parts: dict[str, list[Block]] = {
        "Joints": [Table("joints", "what pulses and slow motion show", head, tuple(rows))],
        "Model": [
            Words(sentence(f"{results.outcome.verdict}")),
            Links((("report of the model", f"{results.folder.relative_to(out)}/report.html"),)),
        ],
        "Step on the arm": [
            Words("The new controller on the arm, and the same step on the twin of the model."),
            _figures(steps),
            Plots((("", _steps(design, steps)),), wide=True),
        ],
        "Margins": [Links((("report of the controller", "servo/report.html"),))],
    }
    lines = [sentence(line) for line in summary_lines(design)]
    return render_page(f"Commissioning of {rig.name}", lines, parts)


def _figures(steps: Steps) -> Table:
    """Return the figures of the steps on the arm beside those of the twin."""
    rows = [
        (
            axis_label(mine.output),
            f"{size:.3g}",
            where,
            f"{100.0 * each.overshoot:.1f}",
            f"{each.settling_s:.2f}" if np.isfinite(each.settling_s) else "-",
            f"{100.0 * each.steady_error:+.2f}",
        )
        for size, mine, other in zip(steps.steps, steps.results, steps.predicted, strict=True)
        for where, each in (("arm", mine), ("twin", other))
    ]
    head = ("output", "step", "on", "overshoot, %", "settling time (2 %), s", "steady error, %")
    return Table("steps", "steps on the arm and on its twin", head, tuple(rows))


def _steps(design: ServoDesign, steps: Steps) -> str:
    """Plot the tracked outputs and the commands of arm and twin."""
    gains = design.gains
    samples = min(len(steps.arm.y), len(steps.twin.y))
    time_s = np.arange(samples) / gains.rate_hz
    panels = []
    names = [*((name, "y") for name in gains.tracked), *((name, "u") for name in gains.inputs)]
    for name, kind in names:
        place = (gains.outputs if kind == "y" else gains.inputs).index(name)
        arm, twin = (getattr(run, kind)[:samples, place] for run in (steps.arm, steps.twin))
        found = [
            marks.line(time_s, arm, marks.SOLID, "arm"),
            marks.line(time_s, twin, marks.DASHED, "twin"),
        ]
        panels.append(Panel(Axis.around(axis_label(name), [arm, twin]), found, "height:12rem"))
    x = Axis("time, s", 0.0, float(time_s[-1]), ticks=8)
    return chart(View("step over time", x, panels))

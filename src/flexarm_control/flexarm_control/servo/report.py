"""Report of a servo: its figures, margins, sensitivities, loop, and steps on twins."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_control.servo.robustness import VIBRATES, sensitivities, variations
from flexarm_core.labels import axis_label
from flexarm_core.outputs import MARK_KEY
from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.report.content.blocks import Plots, Table, Words
from flexarm_ident.report.content.wording import sentence
from flexarm_ident.report.page import render_page
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.chart import Panel, View, chart
from flexarm_ident.report.plots.marks import Axis

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.servo.job import ServoDesign
    from flexarm_control.servo.twin import StepResult
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.report.content.blocks import Block

_POINTS = 400
_HIGH = "height:12rem"


def summary(design: ServoDesign) -> dict[str, Any]:
    """Return the figures of a design for ``summary.json``."""
    gains, (model, worst) = design.gains, design.choice.worst
    return {
        **MARK_KEY,
        "law": design.law,
        "inputs": list(gains.inputs),
        "outputs": list(gains.outputs),
        "tracked": list(gains.tracked),
        "rate_hz": gains.rate_hz,
        "bandwidth_hz": gains.bandwidth_hz,
        "disk_margin": float(worst.disk),
        "disk_margin_of": model,
        "limited_by": design.choice.limit,
        "limits": [limit if isfinite(limit) else None for limit in gains.limits.tolist()],
        "step": [
            {
                "output": each.output,
                "size": float(size),
                **step_figures(each),
            }
            for each, size in zip(design.results, design.steps, strict=True)
        ],
        "notes": list(design.notes),
    }


def step_figures(step: StepResult) -> dict[str, float | None]:
    """Return the figures of a step for JSON, which has no infinity."""
    return {
        "overshoot": step.overshoot,
        "settling_s": step.settling_s if isfinite(step.settling_s) else None,
        "steady_error": step.steady_error,
    }


def summary_lines(design: ServoDesign) -> list[str]:
    """Return a design in a few lines."""
    gains, (model, worst) = design.gains, design.choice.worst
    place = f"with {model}, at {worst.frequency_hz:.3g} Hz, {worst.place}"
    lines = [
        f"bandwidth {gains.bandwidth_hz:.3g} Hz, limited by: {design.choice.limit}",
        f"worst disk margin {worst.disk:.2f} ({place})",
    ]
    for column, each in enumerate(design.results):
        others = [results[column] for results in design.other_results]
        slowest = max(other.settling_s for other in others)
        lines.append(
            f"step of {each.output} by {design.steps[column]:.3g} on the twin: overshoot "
            f"{100.0 * each.overshoot:.1f} %, settling time (2 %) {_seconds(each.settling_s)}, "
            f"steady error {100.0 * each.steady_error:+.2f} %; on {len(others)} perturbed twins "
            f"at most {100.0 * max(other.overshoot for other in others):.1f} % and "
            f"{_seconds(slowest)}"
        )
    return [*lines, *design.notes]


def report(design: ServoDesign) -> str:
    """Return the report of a design as one HTML page."""
    gains = design.gains
    title = f"Law {design.law} of {', '.join(gains.tracked)}"
    parts: dict[str, list[Block]] = {
        "Steps": [
            Words(
                "All tracked outputs step at once: the twin has the model's friction, the record's "
                f"noise, the limits and the delay of the loop. The band is that of "
                f"{len(design.others)} perturbed twins."
            ),
            Plots((("", _steps(design)),), wide=True),
        ],
        "Margins": [
            Words(
                "The disk margin is the largest size of simultaneous errors of gain and phase that "
                f"the loop tolerates, in all inputs together or in one output. The model's "
                f"vibrations (damping ratio below {VIBRATES:g}) are varied in frequency as named."
            ),
            _margins(design),
        ],
        "Loop": [Plots((("", _loop(design)),), wide=True)],
    }
    return render_page(title, [sentence(line) for line in summary_lines(design)], parts)


def _margins(design: ServoDesign) -> Table:
    rows = tuple(
        (
            name,
            f"{margin.disk:.2f}",
            f"{margin.frequency_hz:.3g}" if margin.disk else "-",
            margin.place,
        )
        for name, margin in design.choice.margins.items()
    )
    return Table("margins", "disk margins", ("model", "disk margin", "at, Hz", "in"), rows)


def _loop(design: ServoDesign) -> str:
    """Plot largest singular values of loop and sensitivities, with bands over the models."""
    regulator = design.choice.regulator
    rate_hz = design.gains.rate_hz
    frequency_hz = np.geomspace(0.01 * regulator.bandwidth_hz, 0.5 * rate_hz, _POINTS)
    plants = [
        each
        for name, plant in design.plants.items()
        for each in variations(name, plant, design.shown_hz).values()
    ]
    law = frequency_response(regulator.controller, frequency_hz)
    curves: dict[str, list[FloatArray]] = {"sensitivity": [], "complementary": [], "loop": []}
    for plant in plants:
        inner, outer = sensitivities(regulator, plant, frequency_hz)
        loop = law @ frequency_response(plant, frequency_hz)
        curves["sensitivity"].append(_largest(inner))
        curves["complementary"].append(_largest(np.eye(len(outer[0])) - outer))
        curves["loop"].append(_largest(loop))
    x = Axis.around("frequency, Hz", [frequency_hz], log=True)
    panels = []
    titles = {
        "sensitivity": "sensitivity at the inputs",
        "complementary": "complementary sensitivity at the outputs",
        "loop": "loop at the inputs",
    }
    for name, found in curves.items():
        low, high = np.min(found, axis=0), np.max(found, axis=0)
        # Signals of several units have no common size: zero is nothing to draw on logarithms.
        y = Axis.around(titles[name], [low, high], log=True)
        band = marks.between(frequency_hz, low, high, marks.BAND, "models and variations")
        panels.append(Panel(y, [band, marks.line(frequency_hz, found[0], marks.SOLID, "model")]))
    return chart(View("largest singular values over frequency", x, panels))


def _steps(design: ServoDesign) -> str:
    """Plot the tracked outputs and the commands, with bands over the perturbed twins."""
    gains = design.gains
    time_s = np.arange(len(design.run.y)) / gains.rate_hz
    rows = np.unique(np.linspace(0, len(time_s) - 1, 2 * _POINTS).astype(int))
    panels = []
    for name, size in zip(gains.tracked, design.steps, strict=True):
        place = gains.outputs.index(name)
        runs = [run.y[rows, place] for run in design.others]
        panels.append(_panel(time_s[rows], name, design.run.y[rows, place], runs, float(size)))
    for place, name in enumerate(gains.inputs):
        runs = [run.u[rows, place] for run in design.others]
        panels.append(_panel(time_s[rows], name, design.run.u[rows, place], runs, None))
    x = Axis("time, s", 0.0, float(time_s[-1]), ticks=8)
    return chart(View("steps over time", x, panels))


def _panel(
    time_s: FloatArray,
    name: str,
    run: FloatArray,
    others: Sequence[FloatArray],
    wanted: float | None,
) -> Panel:
    low, high = np.min(others, axis=0), np.max(others, axis=0)
    y = Axis.around(axis_label(name), [low, high, run])
    found = [
        marks.between(time_s, low, high, marks.BAND, "perturbed twins"),
        marks.line(time_s, run, marks.SOLID, "twin"),
    ]
    if wanted is not None:
        goal = marks.line(time_s, np.full(len(time_s), wanted), marks.DASHED, "set-point")
        found.append(goal)
    return Panel(y, found, _HIGH)


def _largest(matrices: Any) -> FloatArray:  # noqa: ANN401 - complex, (frequencies, rows, columns)
    return np.asarray(np.linalg.svd(matrices, compute_uv=False)[:, 0])


def _seconds(time_s: float) -> str:
    return f"{time_s:.2f} s" if isfinite(time_s) else "never"

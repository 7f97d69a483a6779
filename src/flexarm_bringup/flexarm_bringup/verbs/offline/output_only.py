"""Modes from outputs alone, and the input shapers that suit them: `identify --output-only`."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexarm_bringup.console import terminal
from flexarm_control.shaping.shapers import (
    ACCELERATION_MM_S2,
    ALLOWED,
    CORNER_MM_S,
    LARGEST_SMOOTHING_MM,
    SeenMode,
    ShaperFigures,
    Vibration,
    compared_shapers,
    recommended,
)
from flexarm_core.labels import counted, label_and_unit, with_deviation
from flexarm_core.outputs import require_place, write_facts
from flexarm_ident.estimation.output_only import OutputMode, OutputModes, identify_modes
from flexarm_ident.job import REPORT_FILE, model_name, read_whole
from flexarm_ident.report.content.blocks import Block, Code, Plots, Table, Words
from flexarm_ident.report.page import render_page
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.chart import Panel, View, chart
from flexarm_ident.report.plots.marks import Axis

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from rich.table import Table as TerminalTable

    from flexarm_ident.job import Chosen
    from flexarm_ident.records.span import Span

MODES_FILE = "modes.json"
_UNKNOWN = (
    "Not known without an input: gains, the scale of the shapes, and which force excites a mode."
)
_HEADER = ("frequency Hz", "damping", "kind")
_SHAPER_HEADER = (
    "shaper",
    "frequency Hz",
    "remaining",
    "at modes",
    "smoothing mm",
    "acceleration mm/s^2",
)
_ABOUT_SHAPERS = (
    f"Remaining: what of the spectrum stands above {ALLOWED:.0%} of its peak behind the shaper, "
    "over what stands above it before. At modes: the most that remains of a mode within two "
    "deviations of its frequency. Smoothing: how far the path is off a corner at "
    f"{ACCELERATION_MM_S2:g} mm/s^2 and {CORNER_MM_S:g} mm/s. Acceleration: that of a smoothing of "
    f"{LARGEST_SMOOTHING_MM:g} mm."
)
# Amplitude of an output in a mode from which the mode counts there.
_MOVES = 0.3


class Shaped(NamedTuple):
    """Shapers of one output: all of them, the one to take and why, and lines to paste."""

    output: str
    compared: tuple[ShaperFigures, ...]
    best: ShaperFigures
    reason: str
    lines: tuple[str, ...]


def show_modes(
    bags: Sequence[Path],
    out: Path,
    *,
    channels: Chosen,
    span: Span,
    force: bool,
) -> None:
    """Print modes and shapers of records without an input, and write `modes.json` and a report."""
    files = out / MODES_FILE, out / REPORT_FILE
    require_place(files, force=force)
    with terminal.busy("modes from outputs alone"):
        records = [read_whole(bag, channels, span) for bag in bags]
        found = identify_modes(records)
        shaped = [each for output in found.outputs if (each := _shaped(found, output))]
    terminal.step(_verdict(found))
    rows = [_row(mode) for mode in found.found]
    head = (*_HEADER, *(label_and_unit(name)[0] for name in found.outputs))
    if rows:
        terminal.show_table(_terminal_table(head, rows))
    for each in shaped:
        terminal.step(_recommendation(each))
        terminal.show_table(_terminal_table(_SHAPER_HEADER, map(_figures, each.compared)))
        for line in each.lines:
            terminal.CONSOLE.print(f"    {line}")
    terminal.note(_UNKNOWN)
    for record in records:
        for notice in record.notices:
            terminal.note(f"{notice.grade}: {notice}")
    out.mkdir(parents=True, exist_ok=True)
    name = model_name(bags[0])
    write_facts(files[0], _summary(found, shaped))
    files[1].write_text(_page(name, found, shaped, head, rows), "utf-8")
    terminal.CONSOLE.print(f"results in {out}")


def _verdict(found: OutputModes) -> str:
    lines = len(found.found) - len(found.modes)
    read = f" and {counted(lines, 'undamped line')}" if lines else ""
    if found.modes:
        return f"{counted(len(found.modes), 'mode')}{read} from outputs alone"
    return (
        f"no mode{read}: no resonance stands out of the noise; excite the structure while it is "
        "recorded, or record longer"
    )


def _moved(size: float, phase: float) -> str:
    """Return an amplitude with its phase; what does not move has none."""
    return f"{size:.2f} {round(phase)}\u00b0" if round(size, 2) else f"{size:.2f}"


def _row(mode: OutputMode) -> tuple[str, ...]:
    shape = zip(np.abs(mode.shape), np.degrees(np.angle(mode.shape)), mode.share, strict=True)
    return (
        with_deviation(mode.frequency_hz, mode.frequency_std_hz),
        with_deviation(mode.damping_ratio, mode.damping_std),
        "line" if mode.is_line else "mode",
        *(f"{_moved(size, phase)}, {share:.1%}" for size, phase, share in shape),
    )


def _terminal_table(head: Sequence[str], rows: Any) -> TerminalTable:  # noqa: ANN401
    from rich.table import Table as RichTable  # noqa: PLC0415 - of another name here

    table = RichTable(*head, box=None)
    for row in rows:
        table.add_row(*row)
    return table


def _shaped(found: OutputModes, output: str) -> Shaped | None:
    """Return the shapers of an output; None for one that moves most in no mode."""
    number = found.outputs.index(output)
    if not any(np.argmax(np.abs(mode.shape)) == number for mode in found.modes):
        return None
    seen = [
        SeenMode(
            Vibration(mode.frequency_hz, mode.damping_ratio),
            mode.frequency_std_hz,
            float(mode.share[number]),
        )
        for mode in found.modes
        if abs(mode.shape[number]) >= _MOVES
    ]
    compared = compared_shapers(found.frequencies_hz, found.without_lines()[:, number], seen)
    best, reason = recommended(compared)
    return Shaped(output, compared, best, reason, _lines(output, best))


def _lines(output: str, best: ShaperFigures) -> tuple[str, ...]:
    """Return the configuration of a printer's firmware for an axis that it shapes; else none."""
    axis = re.search(r"(?:^|_)([xy])(?:_|$)", output.lower())
    if axis is None:
        return ()
    return (
        "[input_shaper]",
        f"shaper_type_{axis[1]}: {best.name}",
        f"shaper_freq_{axis[1]}: {best.vibration.frequency_hz:.1f}",
        f"damping_ratio_{axis[1]}: {best.vibration.damping_ratio:.3f}",
    )


def _recommendation(shaped: Shaped) -> str:
    best = shaped.best
    limit = (
        f"with at most {best.largest_acceleration_mm_s2:.0f} mm/s^2"
        if best.largest_acceleration_mm_s2
        else f"which rounds every corner by more than {LARGEST_SMOOTHING_MM:g} mm"
    )
    at_hz = best.vibration.frequency_hz
    return f"{shaped.output}: take {best.name} at {at_hz:.1f} Hz, {limit}: {shaped.reason}"


def _figures(each: ShaperFigures) -> tuple[str, ...]:
    return (
        each.name,
        f"{each.vibration.frequency_hz:.1f}",
        f"{each.remaining:.1%}",
        f"{each.at_modes:.1%}",
        f"{each.smoothing_mm:.3f}",
        f"{each.largest_acceleration_mm_s2:.0f}",
    )


def _summary(found: OutputModes, shaped: Sequence[Shaped]) -> dict[str, Any]:
    return {
        "outputs": list(found.outputs),
        "modes": [
            {
                "frequency_hz": mode.frequency_hz,
                "frequency_std_hz": mode.frequency_std_hz,
                "damping_ratio": mode.damping_ratio,
                "damping_std": mode.damping_std,
                "is_line": mode.is_line,
                "amplitude": np.abs(mode.shape).tolist(),
                "phase_deg": np.degrees(np.angle(mode.shape)).tolist(),
                "share": mode.share.tolist(),
            }
            for mode in found.found
        ],
        "shapers": [
            {
                "output": each.output,
                "recommended": each.best.name,
                "reason": each.reason,
                "shapers": [
                    {
                        "name": row.name,
                        "frequency_hz": float(row.vibration.frequency_hz),
                        "damping_ratio": row.vibration.damping_ratio,
                        "remaining": row.remaining,
                        "at_modes": row.at_modes,
                        "smoothing_mm": row.smoothing_mm,
                        "largest_acceleration_mm_s2": row.largest_acceleration_mm_s2,
                    }
                    for row in each.compared
                ],
            }
            for each in shaped
        ],
    }


def _page(
    name: str,
    found: OutputModes,
    shaped: Sequence[Shaped],
    head: tuple[str, ...],
    rows: Sequence[tuple[str, ...]],
) -> str:
    about = (
        "A line has no damping that the record shows: a rotating part or repeated moves, and no "
        "mode. For each output: amplitude and phase of the shape, and the part of its power in the "
        f"half-power band. {_UNKNOWN}"
    )
    parts: dict[str, list[Block]] = {
        "Modes": [Table("modes", "Modes from outputs alone", head, tuple(rows)), Words(about)],
        "Spectra": [Plots((("", _spectra(found)),))],
    }
    for each in shaped:
        figures = tuple(map(_figures, each.compared))
        marked = tuple(row is each.best for row in each.compared)
        parts[f"Input shapers of {each.output}"] = [
            Words(f"{_recommendation(each)}."),
            Table("shapers", f"Input shapers of {each.output}", _SHAPER_HEADER, figures, marked),
            Words(_ABOUT_SHAPERS),
            *map(Code, each.lines),
        ]
    return render_page(f"Modes of {name}", [f"{_verdict(found)}."], parts)


def _spectra(found: OutputModes) -> str:
    """Plot the power spectral density of each output, with the modes."""
    hz = found.frequencies_hz
    x = Axis("frequency, Hz", float(hz[0]), float(hz[-1]))
    decibels = 10.0 * np.log10(np.maximum(found.density, np.finfo(float).tiny))
    panels = []
    for output, curve in zip(found.outputs, decibels.T, strict=True):
        y = Axis.around(f"{label_and_unit(output)[0]}, dB", (curve,))
        at_hz = [mode.frequency_hz for mode in found.found]
        shown = [marks.line(hz, curve, marks.SOLID)]
        if at_hz:
            shown.append(marks.verticals(at_hz, y, marks.RULE, "modes and lines"))
        panels.append(Panel(y, shown))
    return chart(View("power spectral density of each output", x, panels))

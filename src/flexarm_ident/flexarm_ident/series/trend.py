"""Trend of a series: its models over the time of their records, as a plot and a page."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING

from flexarm_core.labels import axis_label, counted
from flexarm_ident.report.content.blocks import Links, Plots, Table
from flexarm_ident.report.page import render_page
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.axis import Axis
from flexarm_ident.report.plots.chart import Panel, View, chart

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from flexarm_ident.report.content.blocks import Block
    from flexarm_ident.report.plots.marks import Mark
    from flexarm_ident.series.rows import Row

_HEAVY = 0.1
_DAY_S = 86_400.0
_LEVEL, _DEVIATION = "friction_", "_std"
_ERRORS = {"error_mean": "simulation", "left_out_mean": "5-fold cross-validation"}
_LOOKS = (marks.SOLID, marks.DASHED, marks.DOTTED, marks.THIN)


def trend_plot(rows: Sequence[Row]) -> str:
    """Plot frequencies, friction levels and errors over the bags, for a page.

    Parameters
    ----------
    rows : sequence of Row
        Bags with a model, one or more. They stand at the time at which their records begin, or at
        their numbers when these are not all different. Modes below 1 % of the heaviest are left
        out.
    """
    places, words = _places(rows)
    levels = {
        column: axis_label(column.removeprefix(_LEVEL))
        for column in sorted({column for row in rows for column in row.cells})
        if column.startswith(_LEVEL) and not column.endswith(_DEVIATION)
    }
    points = [
        (place, hz, weight)
        for place, row in zip(places, rows, strict=True)
        for hz, weight in row.main_modes()
    ]
    frequencies = [
        marks.dots([place for place, _ in shown], [hz for _, hz in shown], look, label)
        for is_heavy, look, label in (
            (True, marks.DOT, "weight of 0.1 or more"),
            (False, marks.SMALL, "less"),
        )
        if (shown := [(at, hz) for at, hz, weight in points if (weight >= _HEAVY) is is_heavy])
    ]
    y = Axis.around("frequency, Hz", [[hz for _, hz, _ in points]], log=True)
    panels = [Panel(y, frequencies)]
    for title, columns in (("friction level", levels), ("relative error", _ERRORS)):
        if curves := list(_curves(places, rows, columns)):
            axis = Axis.around(title, [[0.0], *(curve.y for curve in curves)])
            panels.append(Panel(axis, curves))
    about = f"frequencies and errors of {len(rows)} models over their bags"
    return chart(View(about, Axis.around(words, [places]), panels))


def _curves(
    places: Sequence[float], rows: Sequence[Row], columns: Mapping[str, str]
) -> Iterator[Mark]:
    """Yield each column that has figures, as a line through points."""
    for number, (column, label) in enumerate(columns.items()):
        points = [
            (place, value)
            for place, row in zip(places, rows, strict=True)
            if (value := row.number(column)) is not None
        ]
        if points:
            x, y = zip(*points, strict=True)
            yield marks.line(x, y, _LOOKS[number % len(_LOOKS)], label)
            yield marks.dots(x, y, marks.SMALL, label)


def _places(rows: Sequence[Row]) -> tuple[list[float], str]:
    """Return where the bags stand on the lower axis, and its label."""
    begun = [row.cells.get("begun", "") for row in rows]
    if len(set(begun)) == len(begun) > 1 and all(begun):
        instants = [datetime.fromisoformat(text) for text in begun]
        first = min(instants)
        days = [(each - first).total_seconds() / _DAY_S for each in instants]
        return days, f"begin of the record, days from {first:%Y-%m-%d %H:%M} UTC on"
    return [1.0 + number for number in range(len(rows))], "bag"


def figures(row: Row) -> tuple[str, ...]:
    """Return verdict, order and two fits of a row, %: simulation, cross-validation; or empty."""
    errors = (row.number(name) for name in ("error_mean", "left_out_mean"))
    fits = ("" if error is None else f"{100.0 * (1.0 - error):.1f}" for error in errors)
    return row.cells.get("verdict", ""), row.cells.get("order", ""), *fits


def trend_page(rows: Sequence[Row], plot: str, reports: dict[str, str], table: str) -> str:
    """Return the page of a series.

    Parameters
    ----------
    rows : sequence of Row
        All bags.
    plot : str
        Trend, by `trend_plot`; empty without a model.
    reports : dict of str to str
        Bag -> its report, relative to the page.
    table : str
        File of the table, relative to the page.
    """
    failed = sum(bool(row.failure) for row in rows)
    summary = [f"{counted(len(rows) - failed, 'model')} of {counted(len(rows), 'bag')}."]
    if failed:
        summary.append(f"{counted(failed, 'bag')} without one: the last column says why.")
    columns = (
        "Bag",
        "Begin, UTC",
        "Verdict",
        "Order",
        "Fit, %",
        "5-fold CV, %",
        "Main modes, Hz",
        "No model",
    )
    cells = tuple(
        (
            row.bag,
            row.cells.get("begun", "").replace("T", " ").removesuffix("+00:00"),
            *figures(row),
            ", ".join(f"{hz:.4g}" for hz, _ in row.main_modes()),
            row.failure,
        )
        for row in rows
    )
    parts: dict[str, list[Block]] = {"Trend": [Plots((("", plot),), wide=True)]} if plot else {}
    parts["Bags"] = [Table("bags", "Models of the bags", columns, cells)]
    parts["Files"] = [Links(((table, table), *reports.items()))]
    return render_page("Models of a series", summary, parts)

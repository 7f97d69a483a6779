"""Trend of a series: its models over the time of their records, as a picture and a page."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from flexarm_core.labels import axis_label, counted
from flexarm_ident.report.content.blocks import Links, Plots, Table
from flexarm_ident.report.page import render_page
from flexarm_ident.series.picture import (
    BLACK,
    BLUE,
    STYLE,
    figure_of,
    inline_svg,
    legend_above,
    plain_numbers,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from flexarm_ident.report.content.blocks import Block
    from flexarm_ident.series.rows import Row

_PANEL_IN = 2.2
# Area of the mark of the heaviest mode, and of one without weight, in square points.
_LARGEST, _SMALLEST = 36.0, 3.0
_LEVEL, _DEVIATION = "friction_", "_std"


def trend_plot(rows: Sequence[Row]) -> str:
    """Plot frequencies, friction levels and errors over the bags, as SVG.

    Parameters
    ----------
    rows : sequence of Row
        Bags with a model, one or more. They stand at the time at which their records begin, or at
        their numbers when these are not all different. A frequency's mark is the larger the more
        the mode weighs; those below 1 % of the heaviest are left out.
    """
    levels = sorted(
        {
            column
            for row in rows
            for column in row.cells
            if column.startswith(_LEVEL) and not column.endswith(_DEVIATION)
        }
    )
    with mpl.rc_context(STYLE | {"date.converter": "concise"}):
        figure = figure_of(_PANEL_IN * (3 if levels else 2))
        panels = figure.subplots(3 if levels else 2, sharex=True)
        places = _places(rows, panels[-1])
        points = [
            (place, hz, weight)
            for place, row in zip(places, rows, strict=True)
            for hz, weight in row.main_modes()
        ]
        panels[0].scatter(
            [place for place, _, _ in points],
            [hz for _, hz, _ in points],
            [_SMALLEST + (_LARGEST - _SMALLEST) * weight for _, _, weight in points],
            color=BLACK,
            linewidths=0.0,
        )
        panels[0].set(ylabel="frequency, Hz", yscale="log")
        panels[0].yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panels[0].yaxis.set_major_formatter(plain_numbers())
        panels[0].yaxis.set_minor_formatter(NullFormatter())
        errors = {"error_mean": "simulation", "left_out_mean": "5-fold cross-validation"}
        _lines(panels[-1], places, rows, errors)
        panels[-1].set(ylabel="relative error")
        if levels:
            names = {column: axis_label(column.removeprefix(_LEVEL)) for column in levels}
            _lines(panels[1], places, rows, names)
            panels[1].set(ylabel="friction level")
        return inline_svg(figure, f"frequencies and errors of {len(rows)} models over their bags")


def _lines(axes: Axes, places: Sequence[Any], rows: Sequence[Row], columns: dict[str, str]) -> None:
    looks = (("-", BLUE), ("--", BLACK), (":", BLACK), ("-.", BLUE))
    for number, (column, label) in enumerate(columns.items()):
        points = [
            (place, value)
            for place, row in zip(places, rows, strict=True)
            if (value := row.number(column)) is not None
        ]
        line, color = looks[number % len(looks)]
        if points:
            axes.plot(*zip(*points, strict=True), line, color=color, marker=".", label=label)
    axes.set_ylim(bottom=0.0)
    legend_above(axes)


def _places(rows: Sequence[Row], axes: Axes) -> list[Any]:
    """Return where the bags stand on the lower axis, and label it."""
    begun = [row.cells.get("begun", "") for row in rows]
    if len(set(begun)) == len(begun) > 1 and all(begun):
        axes.set(xlabel="begin of the record, UTC")
        return [datetime.fromisoformat(text) for text in begun]
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="bag")
    return list(range(1, len(rows) + 1))


def figures(row: Row) -> tuple[str, ...]:
    """Return verdict, order and two fits of a row, %: simulation, cross-validation; or empty."""
    errors = (row.number(name) for name in ("error_mean", "left_out_mean"))
    fits = ("" if error is None else f"{100.0 * (1.0 - error):.1f}" for error in errors)
    return row.cells.get("verdict", ""), row.cells.get("order", ""), *fits


def trend_page(rows: Sequence[Row], picture: str, reports: dict[str, str], table: str) -> str:
    """Return the page of a series.

    Parameters
    ----------
    rows : sequence of Row
        All bags.
    picture : str
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
    parts: dict[str, list[Block]] = {"Trend": [Plots((("", picture),))]} if picture else {}
    parts["Bags"] = [Table("bags", "Models of the bags", columns, cells)]
    parts["Files"] = [Links(((table, table), *reports.items()))]
    return render_page("Models of a series", summary, parts)

"""Rows of a series: modes, friction and errors of each bag's model, as a table and their trend."""

from __future__ import annotations

import csv
import os
import re
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING

from flexarm_core.errors import DataError, reason
from flexarm_core.labels import axis_label, counted
from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.report.content.blocks import Links, Plots, Table
from flexarm_ident.report.page import render_page
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.chart import Panel, View, chart
from flexarm_ident.report.plots.marks import Axis

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from flexarm_ident.report.content.blocks import Block
    from flexarm_ident.report.plots.marks import Mark
    from flexarm_ident.workflow.outcome import Outcome

_FIRST = (
    *("bag", "begun", "verdict", "samples", "rate_hz", "method", "order"),
    *("error_mean", "left_out_mean"),
)
_LAST = ("failure", "record_sha256", "request_sha256")
_LIGHTEST = 0.01
_MODE = re.compile(r"(?:frequency|damping|weight)_(\d+)")
_HEAVY = 0.1
_DAY_S = 86_400.0
_LEVEL, _DEVIATION = "friction_", "_std"
_ERRORS = {"error_mean": "simulation", "left_out_mean": "5-fold cross-validation"}
_LOOKS = (marks.SOLID, marks.DASHED, marks.DOTTED, marks.THIN)


@dataclass(frozen=True)
class Row:
    """One bag.

    Attributes
    ----------
    bag : str
        Its path, as it was given.
    cells : mapping of str to str
        Column -> text: ``begun`` (UTC), ``verdict``, ``samples``, ``rate_hz``, ``method``,
        ``order``, errors of each output and their mean, ``left_out_mean`` (cross-validation),
        ``friction_<input>`` with ``_std``; ``frequency_<n>`` in Hz, ``damping_<n>`` and
        ``weight_<n>`` of each vibrating mode, by rising frequency. The weight is its MRM over the
        largest one.
    """

    bag: str
    cells: Mapping[str, str]

    @property
    def failure(self) -> str:
        """Reason why there is no model; empty with one."""
        return self.cells.get("failure", "")

    def is_of(self, record_sha256: str, request_sha256: str) -> bool:
        """Return whether it has the model of a record and a request."""
        made = self.cells.get("record_sha256"), self.cells.get("request_sha256")
        return not self.failure and made == (record_sha256, request_sha256)

    def number(self, column: str) -> float | None:
        """Return a figure; None where there is none."""
        text = self.cells.get(column, "")
        return float(text) if text else None

    def main_modes(self) -> Iterator[tuple[float, float]]:
        """Yield frequency, Hz, and weight of the modes that weigh 1 % of the heaviest, rising."""
        count = 1
        while (frequency_hz := self.number(f"frequency_{count}")) is not None:
            weight = self.number(f"weight_{count}") or 0.0
            if weight >= _LIGHTEST:
                yield frequency_hz, weight
            count += 1


def model_cells(outcome: Outcome) -> dict[str, str]:
    """Return the cells that a model fills."""
    record = outcome.records[0]
    cells = {
        "verdict": str(outcome.verdict.level),
        "samples": str(outcome.samples[0]),
        "rate_hz": _text(1.0 / record.dt_s),
        "method": outcome.identification.method,
        "order": str(outcome.model.nstates),
        "error_mean": _text(mean_error(outcome.dmv_errors)),
    }
    if outcome.cross_validation is not None:
        cells["left_out_mean"] = _text(mean_error(outcome.cross_validation.error))
    for name, error in zip(record.outputs, outcome.dmv_errors.tolist(), strict=True):
        cells[f"error_{name}"] = _text(error)
    if outcome.friction is not None:
        friction = outcome.friction
        for name, level, deviation in zip(
            record.inputs,
            friction.levels.tolist(),
            friction.level_deviations.tolist(),
            strict=True,
        ):
            cells[f"friction_{name}"] = _text(level)
            cells[f"friction_{name}_std"] = _text(deviation)
    modes = [mode for mode in outcome.modes if mode.kept and mode.is_pair]
    heaviest = max((mode.mrm for mode in modes), default=1.0) or 1.0
    modes.sort(key=lambda mode: mode.frequency_hz)
    for number, mode in enumerate(modes, start=1):
        cells[f"frequency_{number}"] = _text(mode.frequency_hz)
        cells[f"damping_{number}"] = _text(mode.damping_ratio)
        cells[f"weight_{number}"] = _text(mode.mrm / heaviest)
    return cells


def _text(figure: float) -> str:
    return f"{figure:.6g}"


def read_rows(file: Path) -> dict[str, Row]:
    """Return the rows of a table by their bags; none when there is no file.

    Raises
    ------
    DataError
        If the file is no such table.
    """
    if not file.exists():
        return {}
    try:
        with file.open(newline="", encoding="utf-8") as stream:
            table = csv.DictReader(stream, strict=True)
            _require_columns(table.fieldnames)
            lines = list(table)
            rows = [
                Row(line["bag"], {column: text for column, text in line.items() if text})
                for line in lines
            ]
    except (OSError, UnicodeDecodeError, csv.Error, KeyError, AttributeError) as error:
        raise DataError(f"{file}: no table of a series: {reason(error)}; move it away") from error
    return {row.bag: row for row in rows}


def _require_columns(found: Sequence[str] | None) -> None:
    """Refuse the columns of another table; an empty file has none and is refilled."""
    for column in ("bag", *_LAST):
        if found is not None and column not in found:
            raise csv.Error(f"no column {column}")


def write_rows(file: Path, rows: Sequence[Row]) -> None:
    """Write a table; whoever reads meanwhile sees the old one or the new one."""
    columns = _columns(rows)
    beside = file.with_name(f".{file.name}.{os.getpid()}")
    with beside.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows({**row.cells, "bag": row.bag} for row in rows)
    beside.replace(file)


def _columns(rows: Sequence[Row]) -> list[str]:
    """Return the columns: figures of the model, then its modes one by one."""
    found = dict.fromkeys(column for row in rows for column in row.cells)
    between = [column for column in found if column not in {*_FIRST, *_LAST}]
    between.sort(key=_place_of_mode)
    return [*_FIRST, *between, *_LAST]


def _place_of_mode(column: str) -> int:
    mode = _MODE.fullmatch(column)
    return int(mode[1]) if mode else 0


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

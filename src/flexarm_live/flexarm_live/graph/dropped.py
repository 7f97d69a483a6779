"""Signals of a record that was dropped on the page: what a user has to say of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flexarm_core.errors import BagError
from flexarm_core.labels import UNIT_ENDINGS, label_and_unit, unit_ending
from flexarm_ident.importing.csv_columns import file_unit, guessed_columns
from flexarm_ident.importing.csv_layout import CsvImportError, is_table
from flexarm_ident.importing.csv_table import table_layout
from flexarm_ident.reading.read import fields_of, sample_count

if TYPE_CHECKING:
    from pathlib import Path


def signals_of(record: Path) -> dict[str, Any]:
    """Return the signals of a CSV file or a bag, as a page is told them.

    Returns
    -------
    dict
        ``signals``, each with its ``name``, its ``unit`` as far as it is told, and its ``role`` by
        its name: ``input``, ``output``, ``time`` or empty. It is an empty list for a bag of
        flexarm's own samples, which says all by itself. ``endings``: how a name ends that says a
        unit. ``has_clock``: the record has the instants of its samples.

    Raises
    ------
    FlexarmError
        When the file cannot be read.
    """
    endings = {unit: f"_{ending}" for ending, unit in UNIT_ENDINGS.items()}
    if is_table(record):
        return {"signals": _of_table(record), "endings": endings, "has_clock": False}
    try:
        sample_count(record)
        names = []
    except BagError:
        names = fields_of(record)
    signals = [{"name": name, "unit": "", "role": ""} for name in names]
    return {"signals": signals, "endings": endings, "has_clock": True}


def _of_table(file: Path) -> list[dict[str, str]]:
    layout = table_layout(file)
    try:
        inputs, outputs = guessed_columns(file, (), ())
    except CsvImportError:
        inputs, outputs = (), ()
    roles = dict.fromkeys(layout.names, "time" if inputs else "")
    roles |= dict.fromkeys(outputs, "output") | dict.fromkeys(inputs, "input")
    return [
        {"name": name, "unit": _unit(name, file_unit(name, layout)), "role": role}
        for name, role in roles.items()
        if name
    ]


def _unit(name: str, told: str) -> str:
    """Return a unit of `UNIT_ENDINGS` that the name or the file tells; empty without one."""
    ending = unit_ending(label_and_unit(name)[1] or told)
    return UNIT_ENDINGS.get(ending.removeprefix("_"), "")

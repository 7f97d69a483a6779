"""Folder of a laboratory's records and models, each known by its name and by nothing else."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

from flexarm_bags.metadata import FILE_NAME
from flexarm_core.errors import BagError, FlexarmError, nearest
from flexarm_core.labels import UNIT_ENDINGS, label_and_unit, unit_ending
from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_columns import file_unit, guessed_columns
from flexarm_ident.importing.csv_layout import is_table
from flexarm_ident.importing.csv_table import table_layout
from flexarm_ident.job import MODEL_FILE, REPORT_FILE
from flexarm_ident.reading.read import fields_of, sample_count

COMPARISON_FILE = "comparison.html"
_PAGES = {"": REPORT_FILE, "comparison": COMPARISON_FILE}
_MODELS = "models"
_DROPPED = "dropped"
_BAG_FILES = frozenset({".mcap", ".db3"})
_LONGEST_NAME = 200


class Store:
    """Records in a folder, and the models that were identified from them below it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def new_bag(self, kind: str) -> Path:
        """Return where a new record goes: its kind and the time of now."""
        self.folder.mkdir(parents=True, exist_ok=True)
        return self.folder / f"{kind}_{datetime.now().astimezone():%Y%m%d_%H%M%S}"

    def bags(self) -> list[str]:
        """Return the names of the records, newest first."""
        return list(self._records())

    def bag(self, name: str) -> Path:
        """Return the place of a record; a `FlexarmError` for a name that is none."""
        records = self._records()
        return records[_known("record", name, list(records))]

    def _records(self) -> dict[str, Path]:
        """Return the places of all records by their names, newest first."""
        bags = [file.parent for file in self.folder.glob(f"*/{FILE_NAME}")]
        bags += [file.parent for file in self.folder.glob(f"{_DROPPED}/*/{FILE_NAME}")]
        files = [each for each in self.folder.glob(f"{_DROPPED}/*") if _is_record_file(each)]
        by_age = sorted((*bags, *files), key=lambda place: place.stat().st_mtime, reverse=True)
        return {place.name: place for place in by_age}

    def place_for(self, name: str) -> Path:
        """Return where a file goes that is dropped on the page: in a folder of such files alone.

        Parameters
        ----------
        name : str
            Name of a CSV file or of a file of a bag, or ``BAG/FILE`` for one in a bag's folder.

        Raises
        ------
        FlexarmError
            When the name leaves that folder, is that of no record, or is taken by one of the arm.
        """
        parts = name.split("/")
        if len(parts) > 2 or not all(map(_is_plain, parts)):  # noqa: PLR2004 - folder and file
            raise FlexarmError(f"{name[:50]!r}: drop a file, or a bag's folder, with a plain name")
        if len(parts) == 1 and not _is_record_file(Path(name)):
            raise FlexarmError(
                f"{name}: drop a CSV file or a bag (.mcap, .db3 or its folder); "
                "save a spreadsheet as CSV"
            )
        if (self.folder / parts[0] / FILE_NAME).exists():
            raise FlexarmError(f"{parts[0]}: a record of the arm has that name: rename the file")
        return self.folder.joinpath(_DROPPED, *parts)

    def models(self) -> list[str]:
        """Return the names of the identified models."""
        found = (self.folder / _MODELS).glob(f"*/{MODEL_FILE}")
        return sorted(file.parent.name for file in found)

    def model_folder(self, name: str) -> Path:
        """Return the folder of the model of a record, which may not be there yet."""
        return self.folder / _MODELS / name

    def model_file(self, name: str) -> Path:
        """Return the file of a model; a `FlexarmError` for a name that is none."""
        return self.model_folder(_known("model", name, self.models())) / MODEL_FILE

    def report(self, address: str) -> bytes | None:
        """Return the report of a model, or with `/comparison` its comparison; None without one."""
        name, _, page = address.partition("/")
        if name not in self.models() or page not in _PAGES:
            return None
        file = self.model_folder(name) / _PAGES[page]
        return file.read_bytes() if file.is_file() else None


def _is_record_file(path: Path) -> bool:
    return is_table(path) or path.suffix in _BAG_FILES


def _is_plain(part: str) -> bool:
    """Return whether a name is one of a file that is seen, in any folder."""
    return (
        0 < len(part.encode()) <= _LONGEST_NAME
        and part.isprintable()
        and part[0] != "."
        and "\\" not in part
    )


def _known(kind: str, name: str, names: list[str]) -> str:
    if name not in names:
        raise FlexarmError(f"no {kind} {name!r}{nearest(name, names)}")
    return name


def signals_of(record: Path) -> dict[str, Any]:
    """Return the signals of a CSV file or a bag, as a page gets them.

    Returns
    -------
    dict
        ``signals``, each with its ``name``, its ``unit`` as far as it is known, and its ``role`` by
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


def _unit(name: str, given: str) -> str:
    """Return a unit of `UNIT_ENDINGS` that the name or the file gives; empty without one."""
    ending = unit_ending(label_and_unit(name)[1] or given)
    return UNIT_ENDINGS.get(ending.removeprefix("_"), "")

"""The table of a series as Parquet, for programs that analyse months of bags."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from flexarm_core.errors import DataError

if TYPE_CHECKING:
    from pathlib import Path

_TEXTS = ("bag", "verdict", "method", "failure", "record_sha256", "request_sha256")


def require_parquet() -> None:
    """Raise a DataError that names the remedy when pyarrow, an optional package, is missing."""
    _arrow()


def write_parquet(table: Path, file: Path) -> None:
    """Write the CSV table of a series as Parquet: figures as numbers, `begun` as an instant."""
    arrow = _arrow()
    csv, parquet = (importlib.import_module(f"pyarrow.{part}") for part in ("csv", "parquet"))
    types = dict.fromkeys(_TEXTS, arrow.string()) | {"begun": arrow.timestamp("s", tz="UTC")}
    # An empty cell is a figure that does not exist.
    options = csv.ConvertOptions(column_types=types, strings_can_be_null=True)
    parquet.write_table(csv.read_csv(table, convert_options=options), file)


def _arrow() -> Any:  # noqa: ANN401 - a module without types
    try:
        return importlib.import_module("pyarrow")
    except ImportError:
        raise DataError("--parquet needs pyarrow: pip install -r requirements/parquet.in") from None

"""Files that are called tables and are none: what they are, and what to do."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING

from flexarm_ident.importing.csv_cells import MISSING, NAME, is_value

if TYPE_CHECKING:
    from collections.abc import Sequence

_CAN = "is a log of CAN frames: decode it to CSV with its database, such as by `cantools`"
_MAT = rb"MATLAB|[\x00-\x34]\x00{3}.{3}\x00.{3}\x00[\x00\x01]\x00{3}[\x01-\x40]\x00{3}"
_JSON = rb'\s*(\[\s*\{|\[\[[^\n]*\],\s*\[|\{\s*"[^"]*"\s*:\s*\[)'
# How files begin that are called or taken for text, and what to do.
BEGINNINGS = tuple(
    (re.compile(begin, re.DOTALL), what)
    for begin, what in (
        (
            rb"PK\x03\x04.{26}[^\x00-\x1f]+?\.npy",
            "has arrays of NumPy: write them by numpy.savetxt",
        ),
        (rb"PK\x03\x04", "is an Excel or OpenDocument workbook or zip file: save its sheet as CSV"),
        (rb"\xd0\xcf\x11\xe0", "is an old Excel workbook: save its sheet as CSV"),
        (rb"PAR1", "is a Parquet file: write it as CSV, such as by pandas.DataFrame.to_csv"),
        (rb"\x89HDF", "is an HDF5 or MATLAB 7.3 file: write its arrays by numpy.savetxt"),
        (_MAT, "is a MATLAB file: write its signals as CSV by MATLAB's writetable"),
        (rb"TDSm", "is a LabVIEW TDMS file: export it as text (.lvm) or CSV"),
        (rb"SQLite format 3", "is a SQLite file: a bag of ROS 2 is called .db3"),
        (rb"\x89MCAP0", "is an MCAP bag: call it .mcap"),
        (rb"#ROSBAG V", "is a bag of ROS 1: convert it by `rosbags-convert`"),
        (rb"\x1f\x8b", "is packed by gzip: unpack it by gunzip"),
        (rb"BZh[1-9]1AY", "is packed by bzip2: unpack it by bunzip2"),
        (rb"\xfd7zXZ", "is packed by xz: unpack it by unxz"),
        (rb"\x28\xb5\x2f\xfd", "is packed by Zstandard: unpack it by unzstd"),
        (rb"\x93NUMPY", "is an array of NumPy: write it by numpy.savetxt"),
        (
            rb"\x80[\x02-\x05]",
            "has pickled objects of Python: write their numbers as CSV from there",
        ),
        (rb"RIFF.{4}WAVE", "is a recording of sound (WAV): write its samples by numpy.savetxt"),
        (rb"RRF", "is a recording of Rerun: write its columns as CSV by its dataframe API"),
        (rb"ULog\x01", "is a log of PX4: write its topics as CSV by `ulog2csv`"),
        (rb"CDF[\x01\x02\x05]", "is a netCDF file: write its variables as CSV, such as by xarray"),
        (
            rb"%PDF|\x89PNG|\xff\xd8\xff",
            "is a document or picture and no table: export the numbers",
        ),
        (rb"<", "is HTML or XML and no table of text: open it and save the table as CSV"),
        (rb"ARROW1", "is an Arrow or Feather file: write it as CSV, such as by pandas"),
        (rb"MDF  ", "is an ASAM MDF file: write its signals as CSV, such as by `asammdf`"),
        (rb"#BEGINGLOBALHEADER", "is the header of a DIAdem file: export its channels as CSV"),
        (rb"\{\\rtf", "is formatted text (RTF): save it as plain text"),
        (_JSON, "is a JSON document: write it as CSV, such as by pandas.read_json and to_csv"),
        (rb"\s*-1\s*\n\s*\d+b?\s*\n", "is a universal file (UFF): write it as CSV by `pyuff`"),
        (rb"date [A-Z][^\n]*\nbase (hex|dec)|;\$FILEVERSION", _CAN),
        (rb"\([0-9.]+\) \w+ [0-9A-Fa-f]+#", _CAN),
        (rb"FMT, \d+, ", "is a log of ArduPilot: write a message as CSV by `mavlogdump.py`"),
        (rb">[^:\n]+:[0-9.]+:", "has one value a row, its name before it: export it as CSV"),
    )
)
_ECHO = re.compile(r"---|(- )?[A-Za-z_]\w*:( \S+)?|- \S+")
_NAMING = frozenset({"field", "signal", "variable", "channel", "topic", "tag", "metric"})
_FEW_ROWS, _WIDE = 10, 50


def other_form(head: Sequence[str], names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return what to do with a text whose signals have no column each; empty for a table.

    Parameters
    ----------
    head : sequence of str
        First lines of the text.
    names : sequence of str
        Names of the columns.
    rows : sequence of sequence of str
        Cells of the rows among the lines that have all columns.
    """
    lines = [line.strip() for line in head if line.strip()]
    if 2 * sum(map(bool, map(_ECHO.fullmatch, lines))) > len(lines):
        return (
            "is the text of `ros2 topic echo`: record a bag, or print it by `ros2 topic echo --csv`"
        )
    if 0 < len(rows) < _FEW_ROWS and all(NAME.fullmatch(cells[0]) for cells in rows):
        if len(rows[0]) > _WIDE:
            return "its signals stand in rows: transpose it, so that each has a column"
        return ""
    words = [
        (name, cells)
        for name, cells in zip(names, zip(*rows, strict=True), strict=False)
        if _are_words(cells)
    ]
    alternating = [name for name, cells in words if _alternate(cells)]
    # Beside a time and a value, names may come one after the other.
    is_pair = bool(rows) and sum(map(is_value, rows[0])) == 2  # noqa: PLR2004
    if is_pair or "_value" in names:
        alternating += [name for name, _ in words if name.strip("_").lower() in _NAMING]
    if not alternating:
        return ""
    return (
        f"has one value a row, and column {alternating[-1]} says of what: give each signal a "
        "column, such as by pandas.DataFrame.pivot"
    )


def _are_words(cells: Sequence[str]) -> bool:
    words = set(cells)
    return not (words & MISSING) and all(
        NAME.fullmatch(word) and not is_value(word) for word in words
    )


def _alternate(cells: Sequence[str]) -> bool:
    """Return whether cells have few words, others from row to row."""
    changes = sum(first != second for first, second in pairwise(cells))
    return 2 * changes > len(cells) > 2 * len(set(cells))

"""SQLite files of bags: what they are where they are not bags."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

from flexarm_core.errors import BagError

if TYPE_CHECKING:
    from pathlib import Path

_MAGIC = b"SQLite format 3\0"
_HEADER_BYTES = 100
_TABLES = frozenset({"topics", "messages"})


def require_database(file: Path) -> None:
    """Refuse a file that is not a bag of SQLite, or a part of one.

    The numbers of the header are those of "Database File Format", sqlite.org/fileformat2.html.

    Raises
    ------
    BagError
        With what the file is, and what to do.
    """
    with file.open("rb") as stream:
        header = stream.read(_HEADER_BYTES)
    if not header:
        raise BagError(f"{file.name}: is empty: nothing was recorded into it")
    if not header.startswith(_MAGIC):
        raise BagError(f"{file.name}: is not a SQLite file, which a .db3 file of ROS 2 is")
    page = int.from_bytes(header[16:18], "big")
    stated = (1 << 16 if page == 1 else page) * int.from_bytes(header[28:32], "big")
    size = file.stat().st_size
    # Writers before SQLite 3.7 did not keep the number of pages.
    if header[24:28] == header[92:96] and size < stated:
        raise BagError(
            f"{file.name}: is cut off, {size} of its {stated} bytes are there: copy it again, or "
            "save what is left by `sqlite3 FILE .recover`"
        )
    try:
        with closing(sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro", uri=True)) as database:
            rows = database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
            tables = {str(name) for (name,) in rows}
    except sqlite3.Error:
        # Who reads it reports what is wrong with it.
        return
    if not tables >= _TABLES:
        there = ", ".join(sorted(tables)) or "none"
        raise BagError(
            f"{file.name}: is a SQLite database and no bag, which has topics and messages; tables: "
            f"{there}"
        )

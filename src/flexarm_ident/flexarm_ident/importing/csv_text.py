"""Text of a table: its encoding, and its lines without what programs put around numbers."""

from __future__ import annotations

import codecs
import re
from contextlib import suppress
from typing import TYPE_CHECKING

from flexarm_core.bounds import require_plain_file
from flexarm_core.errors import reason
from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_forms import BEGINNINGS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path
    from typing import TextIO

# A line of a table has some hundred characters.
_LINE_CHARACTERS = 1 << 20
_AROUND = re.compile(
    r"\s*(?:b(?P<mark>['\"])(?P<bytes>.*?)(?:\\r|\\n)*(?P=mark)"
    r"|[\[({]+(?P<list>(?:\w\([^()]*\)|[^\[\](){}])*)[\])}]+),?\s*"
)
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_FIRST_PRINTED, _SPACES = 0x20, b"\t\n\f\r\x1b"
_NOT_CP1252 = (b"\x81", b"\x8d", b"\x8f", b"\x90", b"\x9d")


def encoding_of(path: Path) -> str:
    """Return the encoding of a text.

    Raises
    ------
    CsvImportError
        If the file cannot be read or is not a text; the message says what it is and what to do.
    BoundError
        If it is not a plain file.
    """
    try:
        require_plain_file(path)
        with path.open("rb") as file:
            start = file.read(1 << 16)
    except OSError as error:
        raise CsvImportError(f"{path}: cannot be read as CSV: {reason(error)}") from error
    for begin, remedy in BEGINNINGS:
        if begin.match(start):
            raise CsvImportError(f"{path}: {remedy}")
    for mark, encoding in _MARKS:
        if start.startswith(mark):
            return encoding
    start = start.rstrip(b"\0") or start
    if 0 in start:
        # Each character of a plain text has a zero beside it.
        for first, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
            if start[first::2].count(0) == start.count(0) == len(start) // 2:
                return encoding
        start = start.replace(b"\0", b"")
        if any(byte < _FIRST_PRINTED and byte not in _SPACES for byte in start):
            raise CsvImportError(f"{path}: is a binary file and no text: export it as CSV")
    with suppress(UnicodeDecodeError):
        codecs.getincrementaldecoder("utf-8")().decode(start)
        return "utf-8"
    return "cp1252" if not any(each in start for each in _NOT_CP1252) else "latin-1"


def opened(path: Path, encoding: str) -> TextIO:
    """Open a text; what is not of its encoding can only be in words."""
    try:
        return path.open(newline="", encoding=encoding, errors="replace")
    except OSError as error:
        raise CsvImportError(f"{path}: cannot be read as CSV: {reason(error)}") from error


def lines_of(file: TextIO, path: Path) -> Iterator[str]:
    """Return the lines of a text, none of which fills the memory.

    Zero bytes end a line, as a computer that lost its power leaves them where it wrote.
    """
    while text := file.readline(_LINE_CHARACTERS):
        if len(text) == _LINE_CHARACTERS:
            raise CsvImportError(f"{path}: a line has {_LINE_CHARACTERS} characters or more")
        yield from map(_plain, filter(None, text.split("\0")))


def _plain(line: str) -> str:
    """Return a line without what stands around it, and with the usual minus.

    Python prints lists in brackets and bytes in marks, and matrices of MATLAB have a semicolon at
    the end of each row.
    """
    if not line.isascii():
        line = line.replace("\u2212", "-").replace("\u2013", "-")
    if line.lstrip()[:1] in {"[", "(", "{", "b"} and (inside := _AROUND.fullmatch(line)):
        return f"{inside['bytes'] or inside['list'] or ''}\n"
    if line.rstrip().endswith(";") and line.count(";") == 1:
        return line.replace(";", "")
    return line


def without_breaks(head: Sequence[str]) -> list[str]:
    """Return lines in which no cell is broken, as spreadsheets break names; their places stay."""
    whole: list[str] = []
    opens = -1
    for k, line in enumerate(head):
        is_odd = line.count('"') % 2 == 1
        if opens >= 0:
            whole[opens] = f"{whole[opens].rstrip()} {line}"
            opens = -1 if is_odd else opens
            whole.append("\n")
            continue
        opens = k if is_odd else -1
        whole.append(line)
    # A mark that nothing ends is one of inches.
    return whole if opens < 0 else list(head)

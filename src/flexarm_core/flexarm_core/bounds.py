"""Bounds of what is read: the kind of file, its bytes, and the values and depth of a text.

Whatever a file says of itself, reading it takes no more memory and time than this module allows.
Texts are read here; `flexarm_bags.bounds` applies the same bounds to bags.
"""

from __future__ import annotations

import errno
import os
import re
import reprlib
import stat
from typing import TYPE_CHECKING

import yaml

from flexarm_core.errors import FlexarmError, SettingError, one_line

if TYPE_CHECKING:
    from pathlib import Path

READ_VARIABLE = "FLEXARM_READ_MB"
"""Environment variable with the megabytes that a small file may take when it is unpacked."""
_READ_MB = 256
_MOST_READ_MB = 1_000_000
# A larger file may take so many times its own size: measured samples shrink to a third or less.
_RATIO = 20

TEXT_BYTES = 8 << 20
"""Longest text: a parameter file with a model of 300 states has half of it."""
VALUES = 200_000
"""Most values of a text, where a value that is named again counts again."""
DEPTH = 64
"""Deepest nesting of a text."""
DIGITS = 400
"""Most characters of a number; seventeen digits tell a double."""

_MORE_ADVICE = f"set {READ_VARIABLE} to more megabytes if you trust it"
_NUMBER = re.compile(r"[-+.]?[0-9][^\s]*")
_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother = 2, 80, 80


# libyaml, where PyYAML has it, is ten times faster.
class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Loader that reads 1e-5 and 1.5e3 as numbers, as YAML 1.2, JSON and ROS's parser do."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)


class BoundError(FlexarmError):
    """Reading a file would take more memory or time than is allowed, or it is not a plain file."""


class YamlError(FlexarmError):
    """A text is not YAML, or too much of it.

    Attributes
    ----------
    said : str
        What is wrong, without the line.
    line : int or None
        Line at which it shows, from 1, if that is known.
    """

    def __init__(self, said: str, line: int | None = None) -> None:
        kind, colon, problem = said.partition(": ")
        super().__init__(said if line is None else f"{kind}{colon}line {line}: {problem}")
        self.said, self.line = said, line


def shown(value: object) -> str:
    """Return a value of a foreign text for a message: short, however long and deep it is."""
    return _SHORT.repr(value)


def read_bytes_allowed() -> int:
    """Return how many bytes a small file may take when it is unpacked.

    Raises
    ------
    SettingError
        If the environment variable has no number of megabytes.
    """
    text = os.environ.get(READ_VARIABLE, str(_READ_MB))
    if not (text.isdecimal() and 1 <= int(text[:9]) <= _MOST_READ_MB):
        raise SettingError(
            f"{READ_VARIABLE} = {shown(text)}: must be a whole number of megabytes, 1 to "
            f"{_MOST_READ_MB}"
        )
    return int(text) << 20


def unpacked_bytes_allowed(packed: int) -> int:
    """Return how many bytes a file of that many bytes may take when it is unpacked."""
    return max(read_bytes_allowed(), _RATIO * packed)


def too_much(allowed: int) -> str:
    """Return what is wrong with a file that takes more when it is unpacked."""
    return (
        f"unpacked it has more than {allowed >> 20} MB, which is a lot for its size: {_MORE_ADVICE}"
    )


def require_plain_file(path: Path) -> int:
    """Return the size of a plain file without large holes.

    Opening a pipe or a device may wait or read for ever, and holes of any size take no disk.

    Raises
    ------
    BoundError
        If it is something else, or its holes are larger than a file may be when unpacked.
    OSError
        If it cannot be opened.
    """
    status = path.stat()
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(status.st_mode):
        raise BoundError(
            f"{path}: is not a plain file (a pipe, socket or device): copy it into one"
        )
    if status.st_size > read_bytes_allowed():
        holes = _hole_bytes(path)
        if holes > read_bytes_allowed():
            raise BoundError(
                f"{path}: {holes >> 20} of its {status.st_size >> 20} MB are holes that were never "
                f"written: cut it (`truncate`), or {_MORE_ADVICE}"
            )
    return status.st_size


def _hole_bytes(path: Path) -> int:
    """Return how many bytes of a file were never written."""
    with path.open("rb", buffering=0) as file:
        size = os.fstat(file.fileno()).st_size
        holes, at = 0, 0
        while at < size:
            start = os.lseek(file.fileno(), at, os.SEEK_HOLE)
            try:
                at = os.lseek(file.fileno(), start, os.SEEK_DATA)
            except OSError:  # no data behind the hole
                at = size
            holes += at - start
        return holes


def read_text_bytes(path: Path, most: int = TEXT_BYTES) -> bytes:
    """Return the bytes of a text file.

    Raises
    ------
    BoundError
        If it is not a plain file, or longer than `most` bytes.
    OSError
        If it cannot be read.
    """
    require_plain_file(path)
    with path.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise BoundError(f"{path}: is longer than {most >> 20} MB, which no such file is")
    return content


def yaml_content(text: str) -> object:
    """Return the content of a YAML text in plain types.

    Raises
    ------
    YamlError
        If it is not YAML, or has more values, depth or digits than `VALUES`, `DEPTH`, `DIGITS`.
    """
    try:
        _require_small(text)
        return yaml.load(text, _Loader)  # noqa: S506 - a safe loader, in C
    except YamlError:
        raise
    except Exception as error:
        # The constructors of PyYAML raise almost anything on odd tags, dates and keys.
        said, line = _problem(error)
        raise YamlError(f"no YAML: {said}", line) from error


def yaml_node(text: str) -> yaml.Node | None:
    """Return where the values of a YAML text stand, for a text that `yaml_content` has read.

    The loader is that of the content: another one refuses some texts that this one reads, such as a
    tab behind a colon.
    """
    return yaml.compose(text, _Loader)


def _problem(error: Exception) -> tuple[str, int | None]:
    """Return what is wrong with a text, and its line where that is known."""
    if not (isinstance(error, yaml.MarkedYAMLError) and error.problem):
        return one_line(error), None
    # What lacks its end shows at the end of the text; the context is where it begins.
    mark = error.context_mark or error.problem_mark
    if mark is None:
        return one_line(error), None
    context = f" ({error.context})" if error.context else ""
    return f"{error.problem}{context}", mark.line + 1


def _require_small(text: str) -> None:
    """Count the values before any is built: an alias counts as all that it names."""
    total = 0
    sizes: dict[str, int] = {}
    begun: list[tuple[str | None, int]] = []
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                said = f"no YAML: *{event.anchor} names nothing that is complete before"
                mark = event.start_mark
                raise YamlError(said, mark.line + 1 if mark else None)
            total += sizes[event.anchor]
        elif isinstance(event, yaml.ScalarEvent):
            total += 1
            sizes |= {event.anchor: 1} if event.anchor else {}
            if len(event.value) > DIGITS and _NUMBER.fullmatch(event.value):
                raise YamlError(f"a number has {len(event.value)} characters, allowed are {DIGITS}")
        elif isinstance(event, yaml.CollectionStartEvent):
            begun.append((event.anchor, total))
            total += 1
            if len(begun) > DEPTH:
                raise YamlError(f"is nested deeper than {DEPTH} levels")
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = begun.pop()
            sizes |= {anchor: total - before} if anchor else {}
        if total > VALUES:
            raise YamlError(f"has more than {VALUES} values, aliases spelt out")

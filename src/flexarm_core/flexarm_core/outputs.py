"""Files that a program writes: it replaces only its own, and finds what it cannot write first."""

from __future__ import annotations

import errno
import json
import os
import re
import tempfile
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

from flexarm_core.errors import FlexarmError, reason

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

MARK: Final = "written by flexarm"
"""Words within the first `HEAD_BYTES` of each file that may be replaced."""
MARK_KEY: Final = {"written_by": "flexarm"}
"""The mark in a file of keys and values, such as JSON."""
HEAD_BYTES: Final = 1024
_MARK = re.compile(rb"written[ _]by\W{1,5}flexarm")


class OutputError(FlexarmError):
    """A result would replace a file of somebody else, or cannot be written."""


def is_replaceable(file: Path) -> bool:
    """Return whether replacing a file loses nothing of somebody else: it has our mark, or nothing.

    A folder, a device or a dangling link is not our own.
    """
    if not file.is_file():
        return not (file.exists() or file.is_symlink())
    try:
        with file.open("rb") as stream:
            head = stream.read(HEAD_BYTES)
    except OSError:
        return False
    return not head or _MARK.search(head) is not None


def require_place(files: Iterable[Path], *, force: bool = False) -> None:
    """Refuse, before any work, a file that cannot be written or is not our own.

    Nothing is created.

    Parameters
    ----------
    files : iterable of Path
        Files that will be written; their folders may be missing.
    force : bool
        Files of others may be replaced too.

    Raises
    ------
    OutputError
        For the first such file, with its name and the way out.
    """
    for file in files:
        try:
            _try_to_write(file)
        except (OSError, ValueError) as error:
            raise OutputError(f"{file}: cannot be written: {reason(error)}") from error
        if not (force or is_replaceable(file)):
            raise OutputError(
                f"{file}: was not written by flexarm: move it away, write elsewhere, or replace it "
                "with --force (a node: its parameter force)"
            )


def require_folder(folder: Path, option: str) -> None:
    """Refuse, before any work, a folder in which no file can be made. Nothing is created.

    Parameters
    ----------
    folder : Path
        Folder that may be missing, as those above it may.
    option : str
        Option that names it.

    Raises
    ------
    OutputError
        With the name of the folder, and the option.
    """
    there = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        why = reason(error) if there.is_dir() else "it is not a folder"
        what = "" if there == folder else f" in {there}"
        raise OutputError(
            f"{folder}: cannot be written{what}: {why}; name another folder with {option}"
        ) from error


def write_facts(file: Path, facts: Mapping[str, Any]) -> None:
    """Write facts as JSON, with our mark."""
    file.write_text(json.dumps({**MARK_KEY, **facts}, indent=2) + "\n", encoding="utf-8")


def _try_to_write(file: Path) -> None:
    """Open a file for writing, or else a file without a name where its folder is or will be."""
    # A name that no file can have is an error here, and "no such file" everywhere else.
    with suppress(FileNotFoundError, NotADirectoryError):
        file.lstat()
    if file.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if file.is_file():
        with file.open("ab"):
            return
    folder = next(each for each in file.absolute().parents if each.exists())
    with tempfile.TemporaryFile(dir=folder):
        pass

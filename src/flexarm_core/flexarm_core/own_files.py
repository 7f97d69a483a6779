"""Files of a user: a private folder, claims, who wrote a file, paths, and files as modules."""

from __future__ import annotations

import fcntl
import os
import stat
import sys
import traceback
from contextlib import contextmanager
from hashlib import sha256
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from tempfile import gettempdir
from typing import TYPE_CHECKING

from flexarm_core.errors import FlexarmError, SettingError, one_line

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import ModuleType

_OTHERS = stat.S_IRWXG | stat.S_IRWXO
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


class OwnFileError(FlexarmError):
    """A file or folder that another user could have put there or may change."""


def private_folder() -> Path:
    """Return a folder that only this user reads and writes, made where it is missing.

    Names in the temporary folder can be guessed, and anybody may put a link there.

    Raises
    ------
    OwnFileError
        If what stands there is a link, no folder, another user's, or open to others.
    OSError
        If it cannot be made.
    """
    folder = Path(gettempdir(), f"flexarm-{os.getuid()}")
    try:
        folder.mkdir(mode=0o700)
    except FileExistsError:
        status = folder.lstat()
        if not stat.S_ISDIR(status.st_mode) or not _is_mine(status, _OTHERS):
            raise OwnFileError(
                f"{folder}: is not a folder of this user alone (mode 0700): remove it, or set "
                "TMPDIR to another folder"
            ) from None
    return folder


@contextmanager
def claimed(descriptor: int, taken: FlexarmError) -> Iterator[None]:
    """Hold an open file or folder for this block alone, and close it.

    Parameters
    ----------
    descriptor : int
        File descriptor.
    taken : FlexarmError
        Raised when another process, or another descriptor of this one, holds it.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise taken from None
    else:
        yield
    finally:
        os.close(descriptor)


def is_own_file(path: Path) -> bool:
    """Return whether a plain file, no link, was written by this user and by nobody else."""
    status = path.lstat()
    return stat.S_ISREG(status.st_mode) and _is_mine(status, _OTHERS_WRITE)


def user_path(text: str) -> Path:
    """Return the path that a text names, with ``~`` and ``~user`` spelt out.

    Raises
    ------
    SettingError
        If there is no such user, or no file can have such a name.
    """
    if "\0" in text:
        raise SettingError(f"{text!r}: no file has a name with a zero byte: correct the path")
    try:
        return Path(text).expanduser()
    except RuntimeError:
        user = Path(text).parts[0]
        raise SettingError(
            f"{text}: no home folder of {user} is known: write the folder out"
        ) from None


def _is_mine(status: os.stat_result, closed: int) -> bool:
    return status.st_uid == os.getuid() and not status.st_mode & closed


def own_module(path: Path, named: str) -> ModuleType:
    """Return the module of a file; its classes can be found again by their names.

    Parameters
    ----------
    path : Path
        The file.
    named : str
        What names it, for messages: a variable or another file.

    Raises
    ------
    SettingError
        If it cannot be read, is not a Python file, or raises.
    """
    if not path.is_file():
        raise SettingError(f"{named}: {path}: no such file")
    place = sha256(str(path.resolve()).encode()).hexdigest()[:8]
    name = f"flexarm_own_{path.stem}_{place}"
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise SettingError(f"{named}: {path}: no Python file: name it with the ending .py")
    module = sys.modules[name] = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except FlexarmError:
        raise
    except (Exception, SystemExit) as error:
        raise SettingError(
            f"{named}: {path}{failed_line(error, path)}: {error_text(error)}"
        ) from error
    return module


def error_text(error: BaseException) -> str:
    """Return the kind and the text of an error in one line."""
    return f"{type(error).__name__}: {one_line(error)}"


def failed_line(error: BaseException, path: Path) -> str:
    """Return the line of a file in which an error came up, to be added to a text; or nothing."""
    if isinstance(error, SyntaxError):
        return f", line {error.lineno}"
    frames = traceback.extract_tb(error.__traceback__)
    lines = [each.lineno for each in frames if each.filename == str(path)]
    return f", line {lines[-1]}" if lines else ""

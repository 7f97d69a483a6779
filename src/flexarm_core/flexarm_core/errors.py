"""Errors that a user can fix: one base class, one line of text each."""

from __future__ import annotations

import errno
import traceback
from pathlib import Path

# A library's error may quote what it could not read.
_LONGEST = 1000


class FlexarmError(Exception):
    """Base of every error whose text is meant for the user.

    The text is one line. It names the file, field or value, and what to do about it.
    """


class SettingError(FlexarmError):
    """A setting, gain, reference or model that cannot be used; the text says what is allowed."""


class IdentificationError(FlexarmError):
    """The data or the request does not allow an identification."""


class DataError(IdentificationError):
    """An experiment's record is malformed."""


class BagError(IdentificationError):
    """A bag cannot be read as the record of an experiment."""


def one_line(error: BaseException) -> str:
    """Return the text of any error in one line, cut when long; its kind where it has no text.

    An error of the operating system is reported as ``FILE: No such file or directory``.
    """
    said = str(error)
    if isinstance(error, OSError) and error.strerror:
        said = reason(error) if error.filename is None else f"{error.filename}: {reason(error)}"
    text = " ".join(said[: 2 * _LONGEST].split()) or type(error).__name__
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]} ..."


def with_place(error: BaseException) -> str:
    """Return kind, text and place of an error of somebody's code in one line."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {one_line(error)} ({Path(place.filename).name}:{place.lineno})"


def reason(error: BaseException) -> str:
    """Return why a file cannot be read or written, in plain words without number and path."""
    if isinstance(error, UnicodeDecodeError):
        return "it is not text in UTF-8"
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:
        return f"{error.strerror}: free some, or write elsewhere"
    return str(getattr(error, "strerror", None) or one_line(error))

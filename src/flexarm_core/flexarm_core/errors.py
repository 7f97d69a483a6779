"""Errors that a user can fix, one line of text each, with the nearest known name."""

from __future__ import annotations

import errno
import traceback
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

# A library's error may quote what it could not read.
_LONGEST = 1000
# Similarity, from 0 to 1, from which two names may mean the same.
_ALIKE = 0.6
_FEW = 8


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


def nearest(name: str, known: Iterable[str]) -> str:
    """Return " (nearest: ...)" to be added to a name that is not known.

    Where none is like it, a few known ones are named, and of many none.
    """
    names = list(known)
    # A part of a name, such as kp of pdpc.kp, is the less like it the longer that is.
    within = sorted((each for each in names if len(name) > 1 and name in each), key=len)
    near = within[:1] or get_close_matches(name, names, n=1, cutoff=_ALIKE)
    if near:
        return f" (nearest: {near[0]})"
    return f" (known: {', '.join(names)})" if 0 < len(names) <= _FEW else ""


def nearest_node(name: str, known: Iterable[str]) -> str:
    """Return the nearest full name of a node, of the same namespace if that has any."""
    nodes = list(known)
    namespace = name.rpartition("/")[0]
    return nearest(name, [each for each in nodes if each.rpartition("/")[0] == namespace] or nodes)

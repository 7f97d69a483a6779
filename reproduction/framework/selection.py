"""Keys of the subjects: their order in the thesis, their pages, and those that are asked for."""

from __future__ import annotations

import difflib
import re
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from reproduction.framework.findings import ReproductionError, Subject

if TYPE_CHECKING:
    from collections.abc import Sequence

    from reproduction.framework.findings import Subject

ALL = "all"
APPENDICES, SENSITIVITY = "appendices", "sensitivity"
KINDS = ("table", "appendix", "figure", "claim", "choice")
"""Kinds of subjects, in the order of a page."""
# After the chapters.
_PAGES = {APPENDICES: "~1", SENSITIVITY: "~2"}
_KEY = re.compile(rf"({'|'.join(KINDS)})-(\d+|[a-z])(?:-(\d+)([a-z]?))?")


def in_order(subjects: Sequence[Subject]) -> tuple[Subject, ...]:
    """Return subjects in the order of the thesis: by chapter, then by kind, then by number.

    Raises
    ------
    ReproductionError
        For a malformed or repeated key.
    """
    keys = [subject.key for subject in subjects]
    twice = sorted({key for key in keys if keys.count(key) > 1})
    if twice:
        raise ReproductionError(f"{', '.join(twice)}: there are two of it")
    return tuple(sorted(subjects, key=lambda subject: _place(subject.key)))


def page_of(key: str) -> str:
    """Return the page that a subject belongs on: ``chapter-2``, ``appendices``, ``sensitivity``."""
    part = _parts(key)[1]
    if part.isdigit():
        return f"chapter-{part}"
    return SENSITIVITY if part == SENSITIVITY[0] else APPENDICES


def select(subjects: Sequence[Subject], wanted: Sequence[str]) -> tuple[Subject, ...]:
    """Return the subjects that are asked for.

    Parameters
    ----------
    subjects : sequence of Subject
        The choice.
    wanted : sequence of str
        Keys, beginnings of keys such as ``appendix-b``, patterns such as ``table-2-*``, pages such
        as ``chapter-3``, or ``all``.

    Raises
    ------
    ReproductionError
        For a word that means no subject; the message names similar ones.
    """
    chosen = set()
    for word in wanted:
        name = word.strip().lower()
        found = [each.key for each in subjects if _is_meant(name, each.key)]
        if not found:
            raise ReproductionError(f"there is no {word!r}{_near(name, subjects)}")
        chosen.update(found)
    return tuple(subject for subject in subjects if subject.key in chosen)


def _is_meant(name: str, key: str) -> bool:
    return name in (ALL, page_of(key)) or key.startswith(f"{name}-") or fnmatchcase(key, name)


def _near(name: str, subjects: Sequence[Subject]) -> str:
    keys = [subject.key for subject in subjects]
    words = [ALL, *dict.fromkeys(map(page_of, keys)), *keys]
    near = difflib.get_close_matches(name, words, n=3)
    hint = f"; did you mean {' or '.join(near)}?" if near else ";"
    return f"{hint} `flexarm reproduce --list` shows what there is"


def _place(key: str) -> tuple[str, int, str, int, str]:
    kind, part, number, letter = _parts(key)
    return _PAGES.get(page_of(key), page_of(key)), KINDS.index(kind), part, int(number or 0), letter


def _parts(key: str) -> tuple[str, str, str, str]:
    found = _KEY.fullmatch(key)
    if found is None:
        raise ReproductionError(f"{key!r} is no key: such as table-2-4, figure-3-11 or table-a-1")
    kind, part, number, letter = found.groups(default="")
    return kind, part, number, letter

"""Nearest known name, for the message about a misspelt one."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


# Similarity, from 0 to 1, from which two names may mean the same.
_ALIKE = 0.6
_FEW = 8


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

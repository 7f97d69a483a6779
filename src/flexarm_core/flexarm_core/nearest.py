"""Nearest known name, for the message about a misspelt one."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


def nearest(name: str, known: Iterable[str]) -> str:
    """Return " (nearest: ...)" to be added to a name that is not known; empty if none is known."""
    near = get_close_matches(name, list(known), n=1, cutoff=0.0)
    return f" (nearest: {near[0]})" if near else ""


def nearest_node(name: str, known: Iterable[str]) -> str:
    """Return the nearest full name of a node, of the same namespace if that has any."""
    nodes = list(known)
    namespace = name.rpartition("/")[0]
    return nearest(name, [each for each in nodes if each.rpartition("/")[0] == namespace] or nodes)

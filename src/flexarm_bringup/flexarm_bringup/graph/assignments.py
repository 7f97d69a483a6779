"""Assignments NAME=VALUE: their values as YAML, and as the kind that a parameter has."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

from flexarm_bringup.graph.processes import LaunchError
from flexarm_core.bounds import YamlError, shown, yaml_content
from flexarm_core.nearest import nearest

if TYPE_CHECKING:
    from collections.abc import Mapping


def parsed(assignment: str) -> tuple[str, Any]:
    """Return name and value of an assignment; a `LaunchError` when it is none."""
    name, sign, text = assignment.partition("=")
    if not (name and sign):
        raise LaunchError(f"{shown(assignment)}: write NAME=VALUE")
    try:
        return name, yaml_content(text)
    except YamlError:
        raise LaunchError(f"{shown(assignment)}: the value is none") from None


def assigned(node: str, values: Mapping[str, Any], present: Mapping[str, Any]) -> dict[str, Any]:
    """Return values as the kinds of a node's present ones.

    Parameters
    ----------
    node : str
        Name of the node.
    values, present : mapping of str to value
        Wanted and present values by the names of the parameters.

    Raises
    ------
    LaunchError
        For a parameter that the node does not have.
    """
    unknown = [f"{name}{nearest(name, present)}" for name in values if name not in present]
    if unknown:
        raise LaunchError(f"{node} has no parameter {', '.join(unknown)}")
    return {name: _as_kind(value, present[name]) for name, value in values.items()}


def _as_kind(value: object, present: object) -> object:
    """Take a number for a float where a float is wanted: 2 and 2e0, a text in YAML, for 2.0."""
    if isinstance(present, float) and isinstance(value, (int, str)) and not isinstance(value, bool):
        with suppress(ValueError):
            return float(value)
    return value

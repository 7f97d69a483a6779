"""Assignments NAME=VALUE: their values as YAML, and as the kind that a parameter has."""

from __future__ import annotations

import math
from array import array
from typing import TYPE_CHECKING, Any, NamedTuple

from flexarm_bringup.console.quantity import in_first_unit, units_of
from flexarm_bringup.graph.processes import LaunchError
from flexarm_core.bounds import YamlError, shown, yaml_content
from flexarm_core.errors import nearest

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_SWITCH = {"off": False, "on": True}


def parsed(assignment: str) -> tuple[str, Any]:
    """Return name and value of an assignment; a `LaunchError` when it is none."""
    name, sign, text = assignment.partition("=")
    if not (name and sign):
        raise LaunchError(f"{shown(assignment)}: write NAME=VALUE")
    if not text:
        # Nothing is the empty text here, and not the null of YAML.
        return name, ""
    if text in _SWITCH:
        # A choice of a text parameter more often than a boolean of YAML.
        return name, text
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
        For a parameter that the node does not have, or a value of another kind.
    """
    unknown = [f"{name}{nearest(name, present)}" for name in values if name not in present]
    if unknown:
        raise LaunchError(f"{node} has no parameter {', '.join(unknown)}")
    bare = {name: _without_unit(name, value, present[name]) for name, value in values.items()}
    for name, value in bare.items():
        kind = _NUMBERS if _are_numbers(present[name]) else _KINDS.get(type(present[name]))
        if kind is not None and not kind.holds(value):
            units = ", ".join(units_of(name)) if isinstance(present[name], float) else ""
            words = f"{kind.words}, or one with its unit ({units})" if units else kind.words
            raise LaunchError(f"{node} {name} = {shown(value)}: must be {words}")
    return {name: _as_kind(value, present[name]) for name, value in bare.items()}


def _as_kind(value: Any, present: object) -> Any:  # noqa: ANN401 - of a YAML text
    if isinstance(present, float):
        return float(value)
    if _are_numbers(present):
        return [float(each) for each in (value if isinstance(value, list) else [value])]
    return _SWITCH.get(str(value), value) if isinstance(present, bool) else value


def _are_numbers(present: object) -> bool:
    return isinstance(present, (list, array)) and all(isinstance(each, float) for each in present)


def _without_unit(name: str, value: Any, present: object) -> Any:  # noqa: ANN401 - of YAML
    """Return a number that was given with a unit in that of its parameter; others as they are."""
    if not (isinstance(present, float) and isinstance(value, str)):
        return value
    number = in_first_unit(value, units_of(name))
    return value if number is None else number


class _Kind(NamedTuple):
    """Kind of a parameter, in words, and whether a value of YAML can be its value."""

    words: str
    holds: Callable[[Any], bool]


def _is_number(value: object) -> bool:
    """Return whether a value is a number: 2 is one for 2.0, and 2e0, a text in YAML, not NaN."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return False
    try:
        return not math.isnan(float(value))
    except (ValueError, OverflowError):
        return False


_KINDS = {
    bool: _Kind("true or false", lambda value: isinstance(value, bool) or value in _SWITCH),
    int: _Kind(
        "a whole number", lambda value: isinstance(value, int) and not isinstance(value, bool)
    ),
    float: _Kind("a number", _is_number),
    str: _Kind("a text", lambda value: isinstance(value, str)),
}
"""Kinds that one word can be; a node judges lists of words itself."""

_NUMBERS = _Kind(
    "numbers, such as [1.0, 2.0]",
    lambda value: all(map(_is_number, value if isinstance(value, list) else [value])),
)

"""Settings of a driver: the entries of a description as a dataclass, checked by name and kind."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Any, Final, TypeVar

from flexarm_core.bounds import shown
from flexarm_core.errors import SettingError, nearest

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_core.rig_description import RigDescription

_SettingsT = TypeVar("_SettingsT")


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_list(is_entry: Callable[[object], bool]) -> Callable[[object], bool]:
    return lambda value: isinstance(value, list) and all(map(is_entry, value))


_KINDS: Final[dict[str, tuple[Callable[[object], bool], str]]] = {
    "str": (_is_text, "a text"),
    "float": (_is_number, "a number"),
    "int": (_is_whole, "a whole number"),
    "bool": (lambda value: isinstance(value, bool), "true or false"),
    "tuple[str, ...]": (_is_list(_is_text), "a list of names"),
    "tuple[float, ...]": (_is_list(_is_number), "a list of numbers"),
}
"""Annotations of fields, with what a value of theirs is."""


def settings_of(kind: type[_SettingsT], rig: RigDescription, **given: object) -> _SettingsT:
    """Return the settings of a rig's driver.

    Parameters
    ----------
    kind : type
        Dataclass whose fields are the settings.
    rig : RigDescription
        The rig.
    **given : object
        Fields that are not settings, such as the rate.

    Raises
    ------
    SettingError
        If a setting is unknown, missing or of another kind, or an input does not rest at zero,
        where these drivers stop it.
    """
    for each in rig.inputs:
        if each.rest:
            raise SettingError(
                f"the driver {rig.driver} stops its outputs at zero, and {each.name} rests at "
                f"{each.rest:g} {each.unit}: count it from there, or write a driver of your own"
            )
    known = {
        field.name: field
        for field in fields(kind)  # type: ignore[arg-type]
        if field.name not in given
    }
    values: dict[str, Any] = {}
    for name, value in rig.settings.items():
        if name not in known:
            raise SettingError(
                f"settings.{name} is not a setting of the driver {rig.driver}{nearest(name, known)}"
            )
        fits, said = _KINDS[str(known[name].type)]
        if not fits(value):
            raise SettingError(f"settings.{name} = {shown(value)} must be {said}")
        values[name] = tuple(value) if isinstance(value, list) else value
    for name, field in known.items():
        if field.default is MISSING and name not in values:
            raise SettingError(f"settings.{name} is missing: the driver {rig.driver} needs it")
    return kind(**values, **given)


def require_count(setting: str, named: Sequence[str], signals: Sequence[str]) -> None:
    """Refuse a setting that does not name one part of the driver for each signal of the rig.

    Raises
    ------
    SettingError
        If it has another number of entries.
    """
    if len(named) != len(signals):
        raise SettingError(
            f"settings.{setting} has {len(named)} entries, and the rig {len(signals)} signals for "
            f"them: {', '.join(signals)}"
        )

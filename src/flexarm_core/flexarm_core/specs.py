"""Parameter tables, which document, declare and check values."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass, field, fields
from typing import TYPE_CHECKING, Any, TypeVar

from flexarm_core.bounds import shown
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True)
class ParameterSpec:
    """Name, default, range and meaning of one parameter.

    Attributes
    ----------
    name : str
        Name, with its unit as a suffix where it has one.
    default : bool, int, float, str or list
        Default value; its type is the type of the parameter.
    description : str
        One sentence for a person who sets the parameter.
    minimum, maximum : float or None
        Closed range of a number; None where it has no bound.
    unit : str
        Unit in words of the thesis, empty for none.
    choices : tuple of str
        Allowed values of a string, or of each string in a list; empty: any.
    read_only : bool
        The value is given at the start and cannot be changed later.
    live : bool
        A change acts at once, and not in the next run only.
    """

    name: str
    default: bool | int | float | str | list[float] | list[str]
    description: str
    minimum: float | None = None
    maximum: float | None = None
    unit: str = ""
    choices: tuple[str, ...] = ()
    read_only: bool = False
    live: bool = False

    @property
    def range_text(self) -> str:
        """The allowed range in words, such as ``0 to 6.857 V``."""
        least, most = self.bounds
        return f"{_number(least)} to {_number(most)} {self.unit}".rstrip()

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest allowed number; infinite where there is no bound."""
        least = -math.inf if self.minimum is None else self.minimum
        return least, math.inf if self.maximum is None else self.maximum

    @property
    def change_acts(self) -> str:
        """When a change of the value acts, in words."""
        if self.read_only:
            return "at the start only"
        return "at once" if self.live else "in the next run"

    def complaint(self, value: object) -> str | None:
        """Return in one line why a value cannot be used, NaN among others; None when it can."""
        chosen = value if isinstance(value, list | tuple) else [value]
        if self.choices and (unknown := [each for each in chosen if each not in self.choices]):
            return f"{self.name} = '{unknown[0]}': must be one of {', '.join(self.choices)}"
        least, most = self.bounds
        for each in chosen:
            if isinstance(each, int | float) and not least <= each <= most:
                number = f"{each:.6g}" if isinstance(each, float) else shown(each)
                return (
                    f"{self.name} = {number} is outside {self.range_text}; "
                    f"choose a value in that range ({self.description})"
                )
        return None

    def check(self, value: object, owner: str) -> None:
        """Refuse a value that cannot be used, of a parameter that belongs to `owner`.

        Raises
        ------
        SettingError
            When the value is out of range or none of the choices.
        """
        if complaint := self.complaint(value):
            raise SettingError(f"{owner}: {complaint}")


def _number(value: float) -> str:
    return f"{value:.0f}" if float(value).is_integer() else f"{value:.4g}"


def setting(
    default: float | tuple[float, ...], minimum: float, maximum: float, unit: str, description: str
) -> Any:  # noqa: ANN401 - a field takes the type of its annotation
    """Return a field of a `Bounded` dataclass: default, range of each number, unit and meaning."""
    meaning = {"minimum": minimum, "maximum": maximum, "unit": unit, "description": description}
    return field(default=default, metadata=meaning)


@dataclass(frozen=True)
class Bounded:
    """Base of frozen dataclasses whose fields are `setting`s and are checked on construction.

    Raises
    ------
    SettingError
        When a field is outside its range.
    """

    def __post_init__(self) -> None:
        for spec in parameter_specs(type(self)):
            spec.check(getattr(self, spec.name), type(self).__name__)


def _plain(default: Any) -> Any:  # noqa: ANN401 - of any parameter
    return list(default) if isinstance(default, tuple) else default


_BoundedT = TypeVar("_BoundedT", bound=Bounded)


def parameter_specs(kind: type[Bounded]) -> tuple[ParameterSpec, ...]:
    """Return the table of the parameters of a `Bounded` dataclass, in the order of its fields."""
    return tuple(
        ParameterSpec(name=each.name, default=_plain(each.default), **each.metadata)
        for each in fields(kind)
        if each.init and each.default is not MISSING
    )


def select(kind: type[_BoundedT], values: Mapping[str, float]) -> _BoundedT:
    """Build a `Bounded` dataclass from those of the values that belong to it."""
    names = [spec.name for spec in parameter_specs(kind)]
    given = {name: values[name] for name in names if name in values}
    # What is frozen can be the key of a cache.
    return kind(**{name: tuple(x) if isinstance(x, list) else x for name, x in given.items()})


def refuse_unknown(
    owner: str, specs: tuple[ParameterSpec, ...], values: Mapping[str, float]
) -> None:
    """Refuse values without a parameter in the table.

    Raises
    ------
    SettingError
        When a name is not in the table; the message lists the known names.
    """
    known = [spec.name for spec in specs]
    for name in values:
        if name not in known:
            raise SettingError(f"{owner} has no parameter {name!r}; it has {', '.join(known)}")

"""Bounded parameters: the one table that documents, declares and checks a value."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from typing import TYPE_CHECKING, Any, TypeVar

from flexarm_core.errors import ControlError

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True)
class ParameterSpec:
    """Name, default, range and meaning of one parameter.

    Attributes
    ----------
    name
        Name, with its unit as a suffix where it has one.
    default
        Default value; an ``int`` marks an integer parameter.
    minimum, maximum
        Closed range of allowed values.
    unit
        Unit in words of the thesis, empty for none.
    description
        One sentence for a person who sets the parameter.
    """

    name: str
    default: float
    minimum: float
    maximum: float
    unit: str
    description: str

    @property
    def range_text(self) -> str:
        """The allowed range in words, such as ``0 to 6.857 V``."""
        return f"{self.minimum:.4g} to {self.maximum:.4g} {self.unit}".rstrip()

    def check(self, value: float, owner: str) -> None:
        """Refuse a value outside the range.

        Parameters
        ----------
        value
            The value to check; NaN is outside every range.
        owner
            What the parameter belongs to, for the message.

        Raises
        ------
        ControlError
            When the value is outside the range; the message states the range.
        """
        if not self.minimum <= value <= self.maximum:
            raise ControlError(
                f"{owner}: {self.name} = {value:.6g} is outside {self.range_text}; "
                f"choose a value in that range ({self.description})"
            )


def limits(minimum: float, maximum: float, unit: str, description: str) -> dict[str, Any]:
    """Field metadata that `parameter_specs` turns into a `ParameterSpec`."""
    return {"minimum": minimum, "maximum": maximum, "unit": unit, "description": description}


@dataclass(frozen=True)
class Bounded:
    """Base of frozen dataclasses whose fields carry `limits` and are checked on construction.

    Raises
    ------
    ControlError
        When a field is outside its range.
    """

    def __post_init__(self) -> None:
        for spec in parameter_specs(type(self)):
            spec.check(getattr(self, spec.name), type(self).__name__)


_BoundedT = TypeVar("_BoundedT", bound=Bounded)


def parameter_specs(kind: type[Bounded]) -> tuple[ParameterSpec, ...]:
    """Table of the parameters of a `Bounded` dataclass, in the order of its fields."""
    return tuple(
        ParameterSpec(name=field.name, default=field.default, **field.metadata)
        for field in fields(kind)
        if field.init and field.default is not MISSING
    )


def select(kind: type[_BoundedT], values: Mapping[str, float]) -> _BoundedT:
    """Build a `Bounded` dataclass from those of the values that belong to it."""
    names = [spec.name for spec in parameter_specs(kind)]
    return kind(**{name: values[name] for name in names if name in values})


def refuse_unknown(
    owner: str, specs: tuple[ParameterSpec, ...], values: Mapping[str, float]
) -> None:
    """Refuse values that no parameter of the table asks for.

    Raises
    ------
    ControlError
        When a name is not in the table; the message lists the known names.
    """
    known = [spec.name for spec in specs]
    for name in values:
        if name not in known:
            raise ControlError(f"{owner} has no parameter {name!r}; it has {', '.join(known)}")

"""Types of arguments: a finite number, and a quantity, which is one with its unit or without."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Mapping

    from click import Context, Parameter

    from flexarm_core.rig_description import Channel

_DIGITS = 9
_NUMBER_AND_UNIT = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?) ?([a-zA-Z°]+)")


class FiniteRange(click.FloatRange):
    """Range as click has it, without NaN, which passes every comparison, and without infinity."""

    def convert(self, value: Any, param: Parameter | None, ctx: Context | None) -> float:  # noqa: ANN401 - as click has it
        """Return the number; a text that is none, or beyond the range, is a usage error."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class Quantity(FiniteRange):
    """Number of one unit, which may be given in others.

    Parameters
    ----------
    units : mapping of str to float
        Units that are known, and what one of each is in the first, which a bare number has.
    least, most : float, optional
        Range, in the first unit.
    """

    name = "quantity"

    def __init__(
        self, units: Mapping[str, float], least: float | None = None, most: float | None = None
    ) -> None:
        super().__init__(least, most)
        self.units = units

    def convert(self, value: Any, param: Parameter | None, ctx: Context | None) -> float:  # noqa: ANN401 - as click has it
        """Return the number in the first unit; an unknown unit is a usage error."""
        found = _NUMBER_AND_UNIT.fullmatch(str(value).strip())
        number, unit = found.groups() if found else (value, next(iter(self.units)))
        if unit not in self.units:
            known = ", ".join(self.units)
            self.fail(f"{value!r} has a unit that is not known here: use {known}.", param, ctx)
        try:
            given = float(number)
        except ValueError:
            first, *others = self.units
            self.fail(
                f"{value!r} is not a number: write one in {first}, or with its unit "
                f"({', '.join([first, *others])}).",
                param,
                ctx,
            )
        if not math.isfinite(given):
            self.fail(f"{value} is not a finite number.", param, ctx)
        per_unit = self.units[unit]
        # A refusal has the unit that was given.
        low = -math.inf if self.min is None else self.min
        high = math.inf if self.max is None else self.max
        least, most = round(low / per_unit, _DIGITS), round(high / per_unit, _DIGITS)
        if not least <= given <= most:
            ends = (
                f"{least:.6g} to {most:.6g} {unit}" if most < math.inf else f"{least:g} {unit} up"
            )
            self.fail(f"{given:g} {unit} is not in the range {ends}.", param, ctx)
        return min(max(given * per_unit, low), high)


FREQUENCY_HZ = {"Hz": 1.0, "kHz": 1e3}
MASS_KG = {"kg": 1.0, "g": 1e-3}
TIME_S = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
VOLTAGE_V = {"V": 1.0, "mV": 1e-3}
_OF_ENDING = {"hz": FREQUENCY_HZ, "kg": MASS_KG, "s": TIME_S, "v": VOLTAGE_V}


def units_of_channel(channel: Channel) -> Mapping[str, float]:
    """Return the units of a rig's channel, its own first: V of a potentiometer, deg, rad."""
    units = {**channel.units}
    if "V" in units:
        units["mV"] = 1e-3 * units["V"]
    if "deg" in units:
        units["°"] = units["deg"]
    return units


def units_of(name: str) -> Mapping[str, float]:
    """Return the units of a parameter by the end of its name; empty for another one."""
    return _OF_ENDING.get(name.rpartition("_")[2], {})


def in_first_unit(text: str, units: Mapping[str, float]) -> float | None:
    """Return a number with one of the units in the first of them; None for another text."""
    found = _NUMBER_AND_UNIT.fullmatch(text.strip())
    return float(found[1]) * units[found[2]] if found and found[2] in units else None

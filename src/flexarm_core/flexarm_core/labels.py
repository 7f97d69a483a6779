"""Readable names and figures: quantity and unit of a channel, counts, values with deviations."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

SI_UNITS: Final = {
    "angle": "rad",
    "rate": "rad/s",
    "moment": "N m",
    "strain": "1",
    "acceleration": "m/s^2",
    "position": "m",
    "velocity": "m/s",
    "current": "A",
    "torque": "N m",
    "force": "N",
    "other": "",
}
"""SI unit of each quantity of a channel."""
PER_SI: Final[Mapping[str, Mapping[str, float]]] = {
    "angle": {"rad": 1.0, "deg": 180.0 / math.pi, "rev": 0.5 / math.pi},
    "rate": {"rad/s": 1.0, "deg/s": 180.0 / math.pi, "rpm": 30.0 / math.pi},
    "moment": {"N m": 1.0, "mN m": 1e3},
    "strain": {"1": 1.0, "ustrain": 1e6},
    "acceleration": {"m/s^2": 1.0, "g": 1.0 / 9.80665},
    "position": {"m": 1.0, "mm": 1e3},
    "velocity": {"m/s": 1.0, "mm/s": 1e3},
    "current": {"A": 1.0, "mA": 1e3},
    "torque": {"N m": 1.0, "mN m": 1e3},
    "force": {"N": 1.0},
}
"""Units in one SI unit, of the units that need no `per_si`."""
RAW_UNITS: Final = ("V", "count", "%")
"""Units of a reading or a command that stand for any quantity, by `per_si`."""
UNIT_ENDINGS: Final[Mapping[str, str]] = {
    "rad_per_s": "rad/s",
    "deg_per_s": "deg/s",
    "m_per_s": "m/s",
    "v_per_s": "V/s",
    "rad_s": "rad/s",
    "deg_s": "deg/s",
    "v": "V",
    "a": "A",
    "deg": "deg",
    "rad": "rad",
    "s": "s",
    "hz": "Hz",
    "kg": "kg",
    "nm": "N m",
    "n": "N",
    "m": "m",
}
"""Unit by the ending of a name that says it; the longer ending counts."""
_TIME_WORDS_S = {
    "s|secs?|seconds?": 1.0,
    "ms|msecs?|millis|milliseconds?": 1e-3,
    # The micro sign and the Greek letter look the same.
    "us|\u00b5s|\u03bcs|usecs?|micros|microseconds?": 1e-6,
    "ns|nsecs?|nanos|nanoseconds?": 1e-9,
    "min|minutes?": 60.0,
    "h|hours?": 3600.0,
    "d|days?": 86400.0,
}
#: Units of time by their usual signs, s.
TIME_UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3.6e3, "d": 8.64e4}
#: How a name ends with a unit: ``time_ms``, ``t [ms]``, ``t (ms)``, ``t/ms``, ``t, ms``, ``t ms``.
TIME_UNIT_ENDING = rf"(?:_| *[\[(/,] *| +)(?:{'|'.join(_TIME_WORDS_S)})[\])]?"
DEADBEAT = 1e-12
"""An eigenvalue of that magnitude is zero but for rounding: its mode has ended after one sample."""
ENDLESS_SAMPLES = 1e7
"""A decay over so many samples or more is that of an integrator."""
# Deviations of ten thousand or more, and those below a ten-millionth, stand with an exponent.
_FEWEST_DECIMALS, _MOST_DECIMALS = -2, 8


def label_and_unit(name: str) -> tuple[str, str]:
    """Return the words and the unit of a channel: ``tip strain`` and ``V`` of ``tip_strain_v``.

    The unit is empty when the name has none.
    """
    for ending, unit in UNIT_ENDINGS.items():
        words = name.removesuffix(f"_{ending}")
        if words not in (name, ""):
            return words.replace("_", " "), unit
    return name.replace("_", " "), ""


def unit_ending(unit: str) -> str:
    """Return how a name ends that says a unit: ``_nm`` for ``N m`` or ``Nm``; empty for others."""
    folded = _folded(unit)
    return next(
        (f"_{ending}" for ending, known in UNIT_ENDINGS.items() if _folded(known) == folded), ""
    )


def _folded(unit: str) -> str:
    return re.sub(r"[ .*\u00b7]", "", unit).lower()


def time_unit_s(column: str) -> float | None:
    """Return the unit at the end of the name of a column of times, s; None without one."""
    if not re.search(f"{TIME_UNIT_ENDING}$", column, re.IGNORECASE):
        return None
    (word,) = re.findall(r"([^\W_]+)\W*$", column)
    return next(s for words, s in _TIME_WORDS_S.items() if re.fullmatch(words, word, re.IGNORECASE))


def without_dots(names: Iterable[str]) -> tuple[str, ...]:
    """Return names of channels with underscores for dots, which a model's signals cannot have."""
    return tuple(name.replace(".", "_") for name in names)


def named_twice(names: Iterable[str]) -> str:
    """Return ``X is named twice`` for the first name that is there before; empty without one."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return f"{name} is named twice"
        seen.add(name)
    return ""


def counted(number: int, noun: str, plural: str = "") -> str:
    """Return a number with its noun: ``1 record``, ``2 records``, ``3 stretches``."""
    return f"{number} {noun if number == 1 else plural or f'{noun}s'}"


def with_deviation(value: float, deviation: float | None, decimals: int = 3) -> str:
    """Return a value with its standard deviation of two digits: ``9.387 ± 0.052``.

    Both have the same decimals; the value alone has `decimals`.
    """
    if deviation is None:
        return f"{value:.{decimals}f}"
    if not 0.0 < deviation < math.inf:
        return f"{value:.4g} \u00b1 {deviation:g}"
    rounded = f"{deviation:.1e}"
    decimals = 1 - int(rounded.partition("e")[2])
    if not _FEWEST_DECIMALS <= decimals <= _MOST_DECIMALS:
        return f"{value:.9g} \u00b1 {rounded}"
    decimals = max(0, decimals)
    return f"{value:.{decimals}f} \u00b1 {float(rounded):.{decimals}f}"


def decay(eigenvalue: complex, dt_s: float) -> str:
    """Return how a real mode decays: by its time constant, ``0.62 s``.

    One next to the unit circle is an ``integrator``, one outside of it ``grows, 0.62 s``, and one
    that is zero but for rounding lasts for ``one sample``. A negative one changes its sign with
    every sample, ``alternates, 0.01 s``: (2-28) gives it a frequency that no sampling can show. A
    pair has an empty text.
    """
    if abs(eigenvalue) <= DEADBEAT:
        return "one sample"
    if eigenvalue.imag:
        return ""
    words = ["alternates"] if eigenvalue.real < 0.0 else []
    rate = abs(math.log(abs(eigenvalue.real)))
    if rate * ENDLESS_SAMPLES <= 1.0:
        return ", ".join(words) or "integrator"
    words += ["grows"] if abs(eigenvalue.real) > 1.0 else []
    return ", ".join([*words, f"{float(f'{dt_s / rate:.2g}'):g} s"])


def instant(row: int, period_s: float) -> str:
    """Return the instant of a row since the first one, which has number 0: ``1.04 s (row 312)``."""
    return f"{row * period_s:.6g} s (row {row})"


def axis_label(name: str) -> str:
    """Return the label of an axis: ``base strain, V``."""
    words, unit = label_and_unit(name)
    return f"{words}, {unit}" if unit else words

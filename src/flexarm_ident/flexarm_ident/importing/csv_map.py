"""Column map of a CSV file: time, inputs and outputs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexarm_core.bounds import read_text_bytes
from flexarm_core.errors import SettingError, reason
from flexarm_core.labels import TIME_UNITS_S, label_and_unit, named_twice, unit_ending
from flexarm_core.yaml_sections import sections_of

if TYPE_CHECKING:
    from pathlib import Path

    from flexarm_core.yaml_sections import Section

# Stamps count nanoseconds, and their seconds end at 2**31.
SLOWEST_HZ, FASTEST_HZ = 1e-3, 1e6


@dataclass(frozen=True)
class CsvChannel:
    """One signal: its column in the file, and its name and unit in the bag."""

    column: str
    name: str
    unit: str = ""


@dataclass(frozen=True)
class CsvMap:
    """Meaning of the columns.

    Attributes
    ----------
    inputs, outputs : tuple of CsvChannel
        Signals in the order of the arrays to be written.
    time : str or None
        Column of the time, in s or the unit that its name ends with; None when there is none.
    rate_hz : float or None
        Sampling rate, Hz, of rows without a time, or to which rows with one are resampled.
    closed_loop : bool
        True when the inputs were computed from the outputs.
    description : str
        Free text for the bag's source.
    time_unit : str
        Unit of the time, ``us``; empty where the name, the file or nothing gives it.
    clocks : tuple of str
        Column of the time of each input and output, where they have times of their own; else empty.
    """

    inputs: tuple[CsvChannel, ...]
    outputs: tuple[CsvChannel, ...]
    time: str | None = None
    rate_hz: float | None = None
    closed_loop: bool = False
    description: str = ""
    time_unit: str = ""
    clocks: tuple[str, ...] = ()

    @property
    def resamples(self) -> bool:
        """Whether rows at the times of a column are resampled to a rate."""
        return self.time is not None and self.rate_hz is not None

    def columns(self) -> tuple[str, ...]:
        """Return the columns to read: time when there is one, inputs, outputs."""
        time = () if self.time is None else (self.time,)
        return (*time, *(channel.column for channel in (*self.inputs, *self.outputs)))


def unit_notes(mapping: CsvMap) -> tuple[str, ...]:
    """Return which units of a map no report will show, as they are not those of the names."""
    channels = [each for each in (*mapping.inputs, *mapping.outputs) if each.unit]
    units = [(each, unit_ending(each.unit), label_and_unit(each.name)[1]) for each in channels]
    notes = [
        f"{each.name} is in {each.unit} by the map and in {own} by its name, which reports go by"
        for each, ending, own in units
        if own and not (ending == unit_ending(own) or re.match(rf"{own}(?!\w)", each.unit))
    ]
    silent = [(each.name, ending) for each, ending, own in units if not own]
    if silent:
        names = ", ".join(name for name, _ in silent)
        example = next((f", as {name}{ending}" for name, ending in silent if ending), "")
        notes.append(
            f"reports show the unit at the end of a name{example}: none that they know in {names}"
        )
    return tuple(notes)


def load_csv_map(path: Path) -> CsvMap:
    """Read and check a map from a YAML file.

    Parameters
    ----------
    path : Path
        File with the keys ``time`` (a column) with ``time_unit``, ``rate_hz`` or both, ``inputs``
        and ``outputs`` (lists of ``column`` with an optional ``name`` and ``unit``),
        ``closed_loop``, ``description``.

    Raises
    ------
    SettingError
        If the file cannot be read.
    SectionError
        With file and line, where an entry is wrong or missing.
    """
    try:
        text = read_text_bytes(path).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SettingError(f"{path}: cannot be read: {reason(error)}") from error
    top = sections_of(text, str(path), remedy="name inputs, outputs, and time or rate_hz")
    if not ("time" in top or "rate_hz" in top):
        top.refuse("give time (a column), rate_hz, or both to resample")
    if "time_unit" in top and "time" not in top:
        top.refuse("time_unit is that of a column: give time, too", "time_unit")
    within = SLOWEST_HZ, FASTEST_HZ
    mapping = CsvMap(
        inputs=_channels(top, "inputs"),
        outputs=_channels(top, "outputs"),
        time=top.text("time") if "time" in top else None,
        time_unit=top.word("time_unit", TIME_UNITS_S) if "time_unit" in top else "",
        rate_hz=top.number("rate_hz", within=within) if "rate_hz" in top else None,
        closed_loop=top.flag("closed_loop"),
        description=top.text("description", ""),
    )
    top.end()
    if twice := named_twice(mapping.columns()):
        top.refuse(f"column {twice}: it is one of time, input and output")
    return mapping


def _channels(top: Section, key: str) -> tuple[CsvChannel, ...]:
    channels = []
    for each in top.listed(key):
        column = each.text("column")
        channels.append(CsvChannel(column, each.text("name", column), each.text("unit", "")))
        each.end()
    if twice := named_twice(channel.name for channel in channels):
        top.refuse(f"{key}: {twice}: give each channel a name of its own", key)
    return tuple(channels)


def is_rate(rate_hz: float) -> bool:
    """Return whether stamps can show a rate."""
    return SLOWEST_HZ <= rate_hz <= FASTEST_HZ

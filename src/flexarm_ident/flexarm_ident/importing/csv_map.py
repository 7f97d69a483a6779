"""Column map of a CSV file: time, inputs and outputs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexarm_core.bounds import YamlError, read_text_bytes, shown, yaml_content
from flexarm_core.errors import FlexarmError, reason
from flexarm_core.labels import TIME_UNITS_S, label_and_unit, named_twice, unit_ending

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_KEYS = {"time", "time_unit", "rate_hz", "inputs", "outputs", "closed_loop", "description"}
_CHANNEL_KEYS = {"column", "name", "unit"}
# Stamps count nanoseconds, and their seconds end at 2**31.
SLOWEST_HZ, FASTEST_HZ = 1e-3, 1e6


class CsvMapError(FlexarmError):
    """Unusable map of a CSV import."""


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
    """

    inputs: tuple[CsvChannel, ...]
    outputs: tuple[CsvChannel, ...]
    time: str | None = None
    rate_hz: float | None = None
    closed_loop: bool = False
    description: str = ""
    time_unit: str = ""

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
    CsvMapError
        If the file cannot be read or a key is missing, unknown or of the wrong kind.
    """
    try:
        content = yaml_content(read_text_bytes(path).decode("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise CsvMapError(f"{path}: cannot be read: {reason(error)}") from error
    except YamlError as error:
        raise CsvMapError(f"{path}: {error}") from error
    if not isinstance(content, dict):
        raise CsvMapError(f"{path}: expected the keys {', '.join(sorted(_KEYS))}")
    _refuse_unknown(content, _KEYS, str(path))
    if not content.keys() & {"time", "rate_hz"}:
        raise CsvMapError(f"{path}: give time (a column), rate_hz, or both to resample")
    mapping = CsvMap(
        inputs=_channels(content, "inputs", path),
        outputs=_channels(content, "outputs", path),
        time=_text(content, "time", path) if "time" in content else None,
        time_unit=_time_unit(content, path) if "time_unit" in content else "",
        rate_hz=_rate(content["rate_hz"], path) if "rate_hz" in content else None,
        closed_loop=_flag(content.get("closed_loop", False), path),
        description=_text(content, "description", path) if "description" in content else "",
    )
    if twice := named_twice(mapping.columns()):
        raise CsvMapError(f"{path}: column {twice}: it is one of time, input and output")
    return mapping


def _refuse_unknown(content: Mapping[object, object], known: set[str], where: str) -> None:
    unknown = sorted(str(key) for key in content if key not in known)
    if unknown:
        raise CsvMapError(f"{where}: unknown key {unknown[0]}; known: {', '.join(sorted(known))}")


def _text(content: Mapping[str, object], key: str, where: object) -> str:
    value = content[key]
    if not isinstance(value, str) or not value.strip():
        raise CsvMapError(f"{where}: {key} must be a text, not {shown(value)}")
    return value.strip()


def _rate(value: object, path: Path) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not is_rate(value):
        raise CsvMapError(
            f"{path}: rate_hz must be a number of {SLOWEST_HZ:g} to {FASTEST_HZ:g}, not "
            f"{shown(value)}"
        )
    return float(value)


def _time_unit(content: Mapping[str, object], path: Path) -> str:
    unit = _text(content, "time_unit", path)
    if unit not in TIME_UNITS_S or "time" not in content:
        raise CsvMapError(
            f"{path}: time_unit must be one of {', '.join(TIME_UNITS_S)}, beside time: {unit}"
        )
    return unit


def is_rate(rate_hz: float) -> bool:
    """Return whether stamps can show a rate."""
    return SLOWEST_HZ <= rate_hz <= FASTEST_HZ


def _flag(value: object, path: Path) -> bool:
    if not isinstance(value, bool):
        raise CsvMapError(f"{path}: closed_loop must be true or false, not {shown(value)}")
    return value


def _channels(content: Mapping[str, object], key: str, path: Path) -> tuple[CsvChannel, ...]:
    entries = content.get(key)
    if not isinstance(entries, list) or not entries:
        raise CsvMapError(f"{path}: {key} must list at least one column")
    channels = tuple(
        _channel(entry, f"{path}: {key}[{index}]") for index, entry in enumerate(entries)
    )
    if twice := named_twice(channel.name for channel in channels):
        raise CsvMapError(f"{path}: {key}: {twice}: give each channel a name of its own")
    return channels


def _channel(entry: object, where: str) -> CsvChannel:
    if not isinstance(entry, dict) or "column" not in entry:
        raise CsvMapError(f"{where} needs a column")
    _refuse_unknown(entry, _CHANNEL_KEYS, where)
    column = _text(entry, "column", where)
    return CsvChannel(
        column,
        _text(entry, "name", where) if "name" in entry else column,
        _text(entry, "unit", where) if "unit" in entry else "",
    )

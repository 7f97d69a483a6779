"""Files of a reference and of a trajectory: CSV with a head of names, one line for each sample."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.learning.trajectory import SIGNALS, Trajectory
from flexarm_core.bounds import BoundError, require_plain_file
from flexarm_core.channels import TRAVEL_V
from flexarm_core.errors import SettingError, reason
from flexarm_core.outputs import MARK

if TYPE_CHECKING:
    from pathlib import Path

    from flexarm_core.arrays import FloatArray

TIME, REFERENCE = "time_s", "reference_v"
_COMMENT = "#"
_LONGEST_S = 3600.0
_UNEVEN = 0.01
"""Largest difference of a step from the mean one, as a part of it."""


def read_reference(path: Path, rate_hz: float) -> FloatArray:
    """Read a reference: columns `time_s`, which rises, and `reference_v`.

    Each value holds until the next one's time, the last one for one sample.

    Parameters
    ----------
    path : Path
        File.
    rate_hz : float
        Sampling rate, Hz.

    Returns
    -------
    ndarray, (samples,)
        Reference, V.

    Raises
    ------
    SettingError
        When the file is no such table; the message names file, line and column.
    """
    columns = _read(path, (TIME, REFERENCE))
    time_s, reference_v = columns[TIME], columns[REFERENCE]
    if (np.diff(time_s) <= 0.0).any():
        line = int(np.argmax(np.diff(time_s) <= 0.0)) + 2
        raise SettingError(f"{path}: {TIME} must rise, and does not after its value {line - 1}")
    if np.abs(reference_v).max() > TRAVEL_V:
        raise SettingError(f"{path}: {REFERENCE} leaves the travel of +-{TRAVEL_V:.3f} V")
    if time_s[-1] - time_s[0] > _LONGEST_S:
        raise SettingError(f"{path}: lasts longer than {_LONGEST_S:g} s: cut it into parts")
    samples = round((time_s[-1] - time_s[0]) * rate_hz) + 1
    # A time that stands a rounding error after its sample is that of the sample.
    at_s = time_s[0] + (np.arange(samples) + 1e-6) / rate_hz
    held: FloatArray = reference_v[np.searchsorted(time_s, at_s, side="right") - 1]
    return held


def read_trajectory(path: Path) -> Trajectory:
    """Read a trajectory of `write_trajectory`, or another one with its columns.

    Raises
    ------
    SettingError
        When the file is no such table, its times are not evenly spaced, or its signals have no
        sense; the message names file, line and column.
    """
    columns = _read(path, (TIME, *SIGNALS))
    steps_s = np.diff(columns[TIME])
    if not len(steps_s) or steps_s.min() <= 0.0 or np.ptp(steps_s) > _UNEVEN * steps_s.mean():
        raise SettingError(f"{path}: {TIME} must rise by equal steps, two samples at least")
    try:
        return Trajectory(1.0 / float(steps_s.mean()), *(columns[name] for name in SIGNALS))
    except SettingError as error:
        raise SettingError(f"{path}: {error}") from error


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write a trajectory, with a comment line before the names."""
    time_s = np.arange(len(trajectory)) / trajectory.rate_hz
    columns = np.column_stack([time_s, *(getattr(trajectory, name) for name in SIGNALS)])
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write(f"{_COMMENT} {MARK}: a trajectory, and the command that is played for it\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow((TIME, *SIGNALS))
        writer.writerows([f"{value:.9g}" for value in row] for row in columns.tolist())


def _read(path: Path, names: tuple[str, ...]) -> dict[str, FloatArray]:
    """Return columns of finite numbers by their names."""
    try:
        require_plain_file(path)
        with path.open(encoding="utf-8-sig", newline="") as stream:
            lines = (line for line in stream if not line.startswith(_COMMENT))
            rows = csv.DictReader(lines, skipinitialspace=True)
            missing = [name for name in names if name not in (rows.fieldnames or ())]
            if missing:
                found = ", ".join(rows.fieldnames or ()) or "nothing"
                raise SettingError(
                    f"{path}: no column {missing[0]}; the first line has {found}: name its columns "
                    f"{', '.join(names)}, with commas between them"
                )
            numbers = [
                [_number(path, n, name, row[name]) for name in names]
                for n, row in enumerate(rows, 1)
            ]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SettingError(f"{path}: cannot be read: {reason(error)}") from error
    except BoundError as error:
        raise SettingError(str(error)) from error
    if not numbers:
        raise SettingError(f"{path}: has no samples after its names")
    return dict(zip(names, np.array(numbers).T.copy(), strict=True))


def _number(path: Path, sample: int, name: str, text: str | None) -> float:
    try:
        number = float(text or "")
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        raise SettingError(f"{path}: sample {sample}, {name} = {text!r}: write a finite number")
    return number

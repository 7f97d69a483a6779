"""Part of a record: what an experimenter wants to have used, or what all sensors have measured."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import DataError
from flexarm_core.labels import instant
from flexarm_ident.records.data_warning import PARTIAL_RECORD, Grade

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flexarm_ident.records.iodata import IoData

# Fewer rows identify nothing.
_FEWEST_ROWS = 50


@dataclass(frozen=True)
class Span:
    """Time from the first row of a record on.

    Attributes
    ----------
    from_s : float
        Instant of the first row that is used.
    to_s : float, optional
        Instant of the first row behind those that are used; None: to the end.
    wrap : float, optional
        How the record is read: the period at which its outputs wrap, as in `read_bag`.

    Raises
    ------
    DataError
        If the second instant is not behind the first, or one is not finite or negative.
    """

    from_s: float = 0.0
    to_s: float | None = None
    wrap: float | None = None

    def __post_init__(self) -> None:
        for option, given_s in (("--from", self.from_s), ("--to", self.to_s)):
            if given_s is not None and not 0.0 <= given_s < math.inf:
                raise DataError(
                    f"{option} {given_s:g} s is not a time in a record: give the seconds from its "
                    "start on (from_s, to_s)"
                )
        if self.to_s is not None and self.to_s <= self.from_s:
            raise DataError(
                f"--to {self.to_s:.9g} s is not behind --from {self.from_s:.9g} s: give a later "
                "end or an earlier start (from_s, to_s)"
            )

    @property
    def is_whole(self) -> bool:
        """Whether all rows are used."""
        return self.from_s == 0.0 and self.to_s is None

    def of(self, record: IoData) -> IoData:
        """Return the part of a record, which has the span in its name.

        Raises
        ------
        DataError
            If the record ends before, or the part has fewer than 50 rows.
        """
        if self.is_whole:
            return record
        end_s = len(record) * record.dt_s
        to_s = end_s if self.to_s is None else self.to_s
        for option, given_s, last_s in (
            ("--from", self.from_s, end_s - record.dt_s),
            ("--to", to_s, end_s + 0.5 * record.dt_s),
        ):
            if given_s > last_s:
                raise DataError(
                    f"{record.label}: {option} {given_s:.9g} s is behind its end at {end_s:.9g} s: "
                    "give an earlier instant"
                )
        first, stop = (round(each / record.dt_s) for each in (self.from_s, to_s))
        if stop - first < _FEWEST_ROWS:
            raise DataError(
                f"{record.label}: --from {self.from_s:.9g} s --to {to_s:.9g} s leaves "
                f"{stop - first} samples, at least {_FEWEST_ROWS} are needed: give a longer part"
            )
        source = f"{record.label}, {self.from_s:.6g} to {to_s:.6g} s"
        return replace(record.rows(slice(first, stop)), source=source)


EVERYTHING = Span()
"""The whole of any record."""


def without(record: IoData, stretches: Iterable[tuple[int, int]]) -> str:
    """Return the options of the longest part between some stretches: ``--from 4s --to 12.5s``.

    Parameters
    ----------
    record : IoData
        Record, or a part of one.
    stretches : iterable of (int, int)
        First row of each stretch, and the one behind its last, in their order.
    """
    edges = [(0, 0), *stretches, (len(record), len(record))]
    gaps = [(before[1], after[0]) for before, after in pairwise(edges)]
    first, stop = max(gaps, key=lambda gap: gap[1] - gap[0])
    from_s, to_s = (record.begins_s + row * record.dt_s for row in (first, stop))
    return part_options(from_s, to_s if stop < len(record) else None)


def part_options(from_s: float, to_s: float | None) -> str:
    """Return the options of a part of a record, s: ``--from 4s --to 12.5s``; None is its end."""
    options = [f"--from {from_s:.9g}s"] if from_s > 0.0 else []
    if to_s is not None:
        options.append(f"--to {to_s:.9g}s")
    return " ".join(options)


def measured(record: IoData) -> IoData:
    """Return a record from the first row on in which each output was measured, with a notice.

    What acted before moved the rig, and a simulation from a state that nobody knows keeps the
    difference for ever.
    """
    if record.missing is None:
        return record
    begins = np.argmin(record.missing, axis=0)
    first, channel = int(begins.max()), int(begins.argmax())
    if first == 0:
        return record
    late = PARTIAL_RECORD(
        f"{record.outputs[channel]} was not measured before {instant(first, record.dt_s)}: the "
        "record is used from there on",
        {"first_row": float(first), "rows": float(len(record))},
        grade=Grade.INFORMATION,
        channel=record.outputs[channel],
    )
    part = record.rows(slice(first, None))
    return replace(part, notices=(*record.notices, late))

"""Parts of a record between holes in which its input is not known.

What acts in such a hole moves the rig, and a rig that integrates keeps the difference for ever. A
part behind the hole is therefore a record of its own, with its own initial state.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

from flexarm_core.arrays import runs
from flexarm_core.labels import counted
from flexarm_ident.records.data_warning import LOST_SAMPLES, Grade
from flexarm_ident.records.holes import LONGEST_FILLED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData

    Span = tuple[int, int]

# Shorter parts would cost more by their initial states than they tell.
_FEWEST_SAMPLES = 200
_MOST_PARTS = 10


def known_parts(record: IoData) -> tuple[IoData, ...]:
    """Return the parts between the longest holes with an unknown input, at most ten.

    Holes of up to `LONGEST_FILLED` samples, and those that would leave fewer than 200 samples on
    one side, stay in their part.

    Parameters
    ----------
    record : IoData
        Record; `input_held` marks the rows with an unknown input.

    Returns
    -------
    tuple of IoData
        The parts, the first with the notices of the record and one on its parts; the record itself
        when it is in one piece.
    """
    if record.input_held is None:
        return (record,)
    holes = _cut(runs(record.input_held).tolist(), len(record))
    if not holes:
        return (record,)
    notice = _notice(record, holes)
    spans = _between(holes, len(record))
    parts = [record.rows(slice(first, last)) for first, last in spans]
    return tuple(
        replace(
            part,
            source=f"{record.label}, {part.begins_s:.4g} to "
            f"{part.begins_s + len(part) * part.dt_s:.4g} s",
            part_of=record.label,
            notices=() if number else (*record.notices, notice),
        )
        for number, part in enumerate(parts)
    )


def _cut(holes: Sequence[Span], samples: int) -> list[Span]:
    """Return the holes to cut at, in their order."""
    chosen: list[Span] = []
    for hole in sorted(holes, key=lambda each: each[0] - each[1]):
        if hole[1] - hole[0] <= LONGEST_FILLED or len(chosen) == _MOST_PARTS - 1:
            break
        tried = sorted([*chosen, hole])
        if all(last - first >= _FEWEST_SAMPLES for first, last in _between(tried, samples)):
            chosen = tried
    return chosen


def _between(holes: Sequence[Span], samples: int) -> list[Span]:
    edges = [(0, 0), *holes, (samples, samples)]
    return [(before[1], after[0]) for before, after in pairwise(edges)]


def _notice(record: IoData, holes: Sequence[Span]) -> DataWarning:
    longest = max(holes, key=lambda each: each[1] - each[0])
    length_s = (longest[1] - longest[0]) * record.dt_s
    begins_s = record.begins_s + longest[0] * record.dt_s
    return LOST_SAMPLES(
        f"the input is not known in {counted(len(holes), 'long hole')}, the longest of "
        f"{length_s:.3g} s at {begins_s:.4g} s: the parts between are records of "
        "their own, each with its initial state",
        {"holes": float(len(holes)), "longest_s": length_s},
        grade=Grade.INFORMATION,
    )

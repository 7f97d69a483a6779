"""Data warnings of an identification: each module of this folder has its `CHECKS`."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

import flexarm_ident.diagnostics
from flexarm_core.labels import counted
from flexarm_ident.diagnostics.check import Looked
from flexarm_ident.records.data_warning import RECORDING, Grade

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flexarm_ident.diagnostics.check import Check
    from flexarm_ident.records.data_warning import DataWarning, Kind
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram

# Figure of the notices of changes in a bag of our own rig, see `reading.recorded_changes`.
_AT = "at_s"


@cache
def checks() -> tuple[Check, ...]:
    """Return all checks of data."""
    folder = flexarm_ident.diagnostics
    modules = [
        import_module(f"{folder.__name__}.{each.name}") for each in iter_modules(folder.__path__)
    ]
    return tuple(check for module in modules for check in getattr(module, "CHECKS", ()))


@cache
def kinds() -> dict[str, Kind]:
    """Return all kinds of data warnings by their codes: those of the reading, then the checks'."""
    return {
        kind.code: kind
        for kind in (*RECORDING, *(kind for check in checks() for kind in check.kinds))
    }


def assess(
    records: Sequence[IoData], gram: BlockGram, *, feedthrough: bool = False, order: int = 0
) -> tuple[DataWarning, ...]:
    """Return the defects of an identification's data; none for good data.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    gram : BlockGram
        Their Gram, of as many block rows as the identification uses.
    feedthrough : bool
        Whether D is fitted.
    order : int
        Order of the model; 0 where there is none yet.

    Returns
    -------
    tuple of DataWarning
        The notices of the records, and what the `checks` find.
    """
    data = Looked(tuple(records), gram, feedthrough, order)
    found = [
        replace(each, record=data.names[record.label])
        for record in records
        for each in record.notices
        if _AT not in each.figures
    ]
    found += [each for check in checks() for each in check.detector(data)]
    repeated, inexact = [], set()
    for name, parts in data.wholes:
        here = list(_warnings(parts))
        repeated += [replace(each, record=name) for each in here]
        # What a bag reports of a change is exact, and what the signals show of it is not.
        inexact |= {
            (data.names[part.label], each.code, each.grade) for part in parts for each in here
        }
    kept = (each for each in found if (each.record, each.code, each.grade) not in inexact)
    return (*kept, *repeated)


def _warnings(parts: Sequence[IoData]) -> Iterator[DataWarning]:
    """Yield the changes that a bag reports within the parts of a record, or in a hole between them.

    The notices are those of the whole record, of which this may be a span.
    """
    dt_s, begin_s = parts[0].dt_s, parts[0].begins_s
    end_s = parts[-1].begins_s + len(parts[-1]) * dt_s
    for each in parts[0].notices:
        # A change at an end is none within.
        if begin_s + 0.5 * dt_s < each.figures.get(_AT, begin_s) < end_s - 0.5 * dt_s:
            yield each


def graded(warnings: Iterable[DataWarning], others: Iterable[tuple[Grade, str]]) -> tuple[str, ...]:
    """Return warnings and other notes as lines that begin with their grades.

    Of a warning about the same channel of several records, that of the first one stands for all.
    """
    alike: dict[tuple[str, str, str], list[DataWarning]] = {}
    for warning in warnings:
        alike.setdefault((warning.code, warning.channel, warning.grade), []).append(warning)
    lines = [line for group in alike.values() for line in _lines(group)]
    lines += list(others)
    grades = list(Grade)
    ordered = sorted(dict.fromkeys(lines), key=lambda line: grades.index(line[0]))
    return tuple(f"{grade}: {text}" for grade, text in ordered)


def _lines(group: list[DataWarning]) -> list[tuple[Grade, str]]:
    first = [warning for warning in group if warning.record == group[0].record]
    more = len({warning.record for warning in group}) - 1
    ending = f" (and {counted(more, 'more record')})" if more else ""
    return [(warning.grade, f"{warning}{ending}") for warning in first]

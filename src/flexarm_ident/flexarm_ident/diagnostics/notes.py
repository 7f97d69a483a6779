"""Notes for the user: graded, each once, the heaviest first."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import counted
from flexarm_ident.records.data_warning import Grade

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flexarm_ident.records.data_warning import DataWarning


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

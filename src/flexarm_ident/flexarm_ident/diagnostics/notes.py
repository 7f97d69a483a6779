"""Notes for the user: graded, each once, the heaviest first."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import counted
from flexarm_ident.records.iodata import Grade

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flexarm_ident.records.iodata import DataWarning


def notes(warnings: Iterable[DataWarning], others: Iterable[tuple[Grade, str]]) -> tuple[str, ...]:
    """Return warnings and other notes as lines that begin with their grades.

    Of the same warning about the same channel of several records, the first one stands for all.
    """
    alike: dict[tuple[str, str], list[DataWarning]] = {}
    for warning in warnings:
        alike.setdefault((warning.name, warning.channel), []).append(warning)
    lines = [(group[0].grade, _line(group)) for group in alike.values()]
    lines += list(others)
    grades = list(Grade)
    ordered = sorted(dict.fromkeys(lines), key=lambda line: grades.index(line[0]))
    return tuple(f"{grade}: {text}" for grade, text in ordered)


def _line(group: list[DataWarning]) -> str:
    more = len({warning.record for warning in group}) - 1
    return f"{group[0]}" + (f" (and {counted(more, 'more record')})" if more else "")

from __future__ import annotations

from flexarm_ident.diagnostics.quality import graded
from flexarm_ident.records.data_warning import DataWarning, Grade


def offset(record: str, channel: str = "strain") -> DataWarning:
    return DataWarning("offset", f"{channel} is all offset", {}, record=record, channel=channel)


def test_graded___notes_of_all_grades___heaviest_first() -> None:
    warnings = [
        offset("run 1"),
        DataWarning("constant_channel", "speed is constant", {}, grade=Grade.DO_NOT_USE),
    ]
    assert graded(warnings, [(Grade.INFORMATION, "moved"), (Grade.CAUTION, "kept")]) == (
        "do not use: speed is constant",
        "caution: run 1: strain is all offset",
        "caution: kept",
        "information: moved",
    )


def test_graded___same_defect_in_three_records___stands_once_for_each_channel() -> None:
    warnings = [offset("a"), offset("a", "speed"), offset("b"), offset("c")]
    assert graded(warnings, [(Grade.CAUTION, "kept"), (Grade.CAUTION, "kept")]) == (
        "caution: a: strain is all offset (and 2 more records)",
        "caution: a: speed is all offset",
        "caution: kept",
    )

"""Registry of the data warnings."""

from __future__ import annotations

from flexarm_ident.diagnostics.quality import checks, kinds
from flexarm_ident.records.data_warning import RECORDING, Grade, Kind
from support.project import PROJECT

# Codes are for programs: one that is renamed breaks them.
CODES = {
    *(
        "lost_samples",
        "sampling",
        "partial_record",
        "converted",
        "plant_changed",
        "table",
        "dropouts",
    ),
    *("constant_channel", "saturation", "dead_sensor", "duplicated_channel", "offset"),
    *("feedback", "drive", "excitation", "few_values", "outliers", "quantisation"),
    *("no_answer", "delay"),
}


def test_kinds___of_all_modules___have_the_codes_that_programs_know() -> None:
    assert set(kinds()) == CODES
    checked = [kind for check in checks() for kind in check.kinds]
    defined = {id(kind): kind.code for kind in (*RECORDING, *checked)}
    assert len(set(defined.values())) == len(defined)


def test_kinds___for_report_and_docs___are_reported_in_one_line_each() -> None:
    for kind in kinds().values():
        assert kind.title[0].isupper()
        for words in (kind.when, kind.remedy):
            assert words
            # They stand in a cell of a table.
            assert not set("|\n") & set(words)


def test_identification_page___has_the_table_of_the_registry() -> None:
    assert "<!-- table of data warnings -->" in (PROJECT / "docs/validation.md").read_text()


def test_kind___called___has_its_code_and_grade_unless_given() -> None:
    kind = Kind("leak", "Leak", "it drips", "close it", Grade.INFORMATION)
    assert (kind("drips").code, kind("drips").grade) == ("leak", Grade.INFORMATION)
    assert kind("pours", {"l": 3.0}, grade=Grade.CAUTION).grade == Grade.CAUTION

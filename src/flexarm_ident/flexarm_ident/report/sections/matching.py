"""Simulation section: outputs of the model under the measured input."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_ident.report.content.blocks import Heading, Section, Words
from flexarm_ident.report.content.match_gallery import RECORDS_SHOWN, match_gallery
from flexarm_ident.report.content.wording import short_labels

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_ident.report.content.blocks import Block, Subject


def _build(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    labels = short_labels(outcome.records)
    for number, record in enumerate(outcome.records[:RECORDS_SHOWN]):
        words = (
            f"{labels[record.label]}: the model is driven by the measured input and nothing else."
        )
        if number:
            yield Heading(SECTION.title, level=2)
        elif len(outcome.records) > RECORDS_SHOWN:
            words += f" The first {RECORDS_SHOWN} of {len(outcome.records)} records are shown."
        yield Words(words)
        yield match_gallery(outcome, number, outcome.dmv[number].y, outcome.dmv[number].error)


SECTION = Section(80, "Simulation", _build)

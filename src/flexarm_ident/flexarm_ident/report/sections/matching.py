"""Simulation sections: the model under the measured input, and under the controller."""

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


def _followed(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    if outcome.sfv is None:
        return
    gains, first = outcome.sfv.gains, outcome.records[0]
    yield Words(
        f"{short_labels(outcome.records)[first.label]}: the controller of the experiment drives "
        f"the model with the recorded set-point, kp = {gains.kp:.3f}, kd = {gains.kd:.3f}, "
        f"ksg = {abs(gains.ksg):.3f}."
    )
    yield match_gallery(outcome, 0, outcome.sfv.y, outcome.sfv.error)


FOLLOWING = Section(
    90, "Closed-loop simulation", _followed, lambda subject: subject.outcome.sfv is not None
)

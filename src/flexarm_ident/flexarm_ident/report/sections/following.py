"""Closed-loop section: outputs of the model under the controller of the experiment."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_ident.report.content.blocks import Section, Words
from flexarm_ident.report.content.match_gallery import match_gallery
from flexarm_ident.report.content.wording import short_labels

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_ident.report.content.blocks import Block, Subject


def _build(subject: Subject) -> Iterator[Block]:
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


SECTION = Section(
    90, "Closed-loop simulation", _build, lambda subject: subject.outcome.sfv is not None
)

"""Dry friction section: levels, what they depend on, and their origin."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import label_and_unit, with_deviation
from flexarm_ident.report.content.blocks import Section, Table, Words

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_ident.friction.dry_friction import DryFriction
    from flexarm_ident.friction.levels import CoulombEstimate
    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome


def _applies(subject: Subject) -> bool:
    outcome = subject.outcome
    return outcome.friction is not None or outcome.identification.coulomb is not None


def _build(subject: Subject) -> Iterator[Block]:
    friction, coulomb = subject.outcome.friction, subject.outcome.identification.coulomb
    if friction is not None:
        yield _fitted(subject.outcome, friction)
        yield Words(
            "The levels were fitted together with the model, by simulation error. The model moves "
            "under the input less friction and offset; the friction follows from its own speeds. "
            "± is the standard deviation, from the residuals and their correlation in time, or "
            "more where levels further away simulate the records equally well. What the friction "
            "depends on was chosen by cross-validation on halves of the records."
        )
    elif coulomb is not None:
        yield _estimated(coulomb)
        yield Words(
            "The levels are from a regression of the input where its drive slips; they are not in "
            "the model. One stands out when it is above three standard deviations and 5 % of the "
            "RMS input."
        )


SECTION = Section(60, "Dry friction", _build, _applies)


def _fitted(outcome: Outcome, friction: DryFriction) -> Table:
    """Return the friction in the model with its deviations and units."""
    head = ["Input", "Unit", "Coulomb level", "Offset"]
    columns = [
        (friction.levels, friction.level_deviations),
        (friction.offsets, friction.offset_deviations),
    ]
    if (more := friction.dependence) is not None:
        head += ["Rise at standstill", "Load coefficient"]
        columns += [(more.rises, more.rise_deviations), (more.loads, more.load_deviations)]
    texts = [
        [with_deviation(*each) for each in zip(value, deviation, strict=True)]
        for value, deviation in columns
    ]
    rows = tuple(
        (*label_and_unit(name), *cells)
        for name, *cells in zip(outcome.model.input_labels, *texts, strict=True)
    )
    return Table("friction", "Dry friction", tuple(head), rows)


def _estimated(coulomb: CoulombEstimate) -> Table:
    """Return the levels by regression, which are not in the model."""
    rows = tuple(
        (*label_and_unit(drive.input), with_deviation(level, deviation), "yes" if present else "no")
        for drive, level, deviation, present in zip(
            coulomb.drives, coulomb.levels, coulomb.deviations, coulomb.significant, strict=True
        )
    )
    return Table("friction", "Dry friction", ("Input", "Unit", "Coulomb level", "Stands out"), rows)

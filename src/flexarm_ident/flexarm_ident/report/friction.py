"""What a report says of dry friction."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import label_and_unit
from flexarm_ident.report.content import Table

if TYPE_CHECKING:
    from flexarm_ident.workflow.workflow import Outcome


def friction_table(outcome: Outcome) -> Table | None:
    """Return levels and offsets with scatter and units; None when nothing is known of friction."""
    friction, coulomb = outcome.friction, outcome.identification.coulomb
    if friction is not None:
        rows = tuple(
            (*label_and_unit(name), _plus_minus(*level), _plus_minus(*offset))
            for name, level, offset in zip(
                outcome.model.input_labels,
                zip(friction.levels, friction.level_deviations, strict=True),
                zip(friction.offsets, friction.offset_deviations, strict=True),
                strict=True,
            )
        )
        return Table(("Input", "Unit", "Coulomb level", "Offset"), rows)
    if coulomb is None:
        return None
    rows = tuple(
        (*label_and_unit(drive.input), _plus_minus(level, deviation), "yes" if present else "no")
        for drive, level, deviation, present in zip(
            coulomb.drives, coulomb.levels, coulomb.deviations, coulomb.significant, strict=True
        )
    )
    return Table(("Input", "Unit", "Coulomb level", "Stands out"), rows)


def friction_words(outcome: Outcome) -> str:
    """Return how the levels were found."""
    if outcome.friction is not None:
        return (
            "The levels were fitted together with the model, by free simulation. The model moves "
            "under the input less friction and offset; the friction follows from its own speeds. "
            "± is the standard deviation, from the residuals and their correlation in time."
        )
    return (
        "The levels are from a regression of the input where its drive slips; they are not in the "
        "model. One stands out when it is above three standard deviations and 5 % of the RMS input."
    )


def _plus_minus(value: float, deviation: float) -> str:
    return f"{value:.4g} \u00b1 {deviation:.2g}"

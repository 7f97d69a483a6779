"""Outcome of an identification whose outputs have other names in all its parts."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import control

if TYPE_CHECKING:
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.workflow.outcome import Outcome


def renamed(outcome: Outcome, records: tuple[IoData, ...], outputs: tuple[str, ...]) -> Outcome:
    """Return an outcome with a reduced model for records whose outputs have these names."""
    full, reduction = outcome.identification, outcome.reduction
    assert reduction is not None
    models = [control.ss(each.model, outputs=list(outputs)) for each in (full, reduction)]
    return replace(
        outcome,
        identification=replace(full, model=models[0], records=records),
        reduction=replace(reduction, model=models[1]),
        records=records,
    )

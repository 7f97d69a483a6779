"""Direct term D: whether the records call for one.

A command of the laboratory acts after the sample that it answers, so its rig has no D. A sensor of
acceleration or of current has one. Two models of the same A and C are fitted, with and without D,
and simulated freely; D is taken when the model without it is worse by more than 3 % and by more
than two standard errors, part by part. A controller that answers within the sample makes such a
correlation as well, so records of a closed loop are not asked.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.errors import IdentificationError
from flexarm_ident.estimation.candidates import candidate
from flexarm_ident.estimation.weighing import spread, within_scatter, within_tolerance
from flexarm_ident.subspace.feedback import reaches_inputs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.estimation.weighing import Choice
    from flexarm_ident.records.iodata import IoData


def calls_for_feedthrough(chosen: Choice, records: Sequence[IoData], *, stable: bool) -> bool:
    """Return whether D improves the simulation of records of an open loop.

    Parameters
    ----------
    chosen : Choice
        Estimator and order without D.
    records : sequence of IoData
        The records themselves, or leading parts that fit into memory.
    stable : bool
        Whether unstable eigenvalues are moved.
    """
    selection, order = chosen
    if any(record.closed_loop for record in records) or reaches_inputs(selection.gram):
        return False
    pieces = spread(records)
    try:
        without, direct = (
            candidate(selection, order, pieces, stable=stable, feedthrough=feedthrough)
            for feedthrough in (False, True)
        )
    except IdentificationError:  # too unstable to simulate
        return False
    return not (within_tolerance(without, direct) or within_scatter(without, direct))

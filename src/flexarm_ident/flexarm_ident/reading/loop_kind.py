"""Was a record made in open or in closed loop? Who commanded says it, else the data do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.records.iodata import IoData
from flexarm_ident.subspace.feedback import BACKGROUND_SAMPLES
from flexarm_ident.subspace.gram import stretches
from flexarm_ident.subspace.loop_test import is_closed_loop

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


def loop_kind(declared: Sequence[bool], judged: Callable[[int], IoData]) -> bool | None:
    """Return whether the inputs of a record were computed from its outputs.

    Parameters
    ----------
    declared : sequence of bool
        What those who commanded declared, each whether it used the outputs; empty when nobody did.
    judged : callable
        Gives the first samples of the record, as many as it is asked for.

    Returns
    -------
    bool or None
        True when somebody closed the loop; None where the data cannot tell.
    """
    if declared:
        return any(declared)
    record = judged(BACKGROUND_SAMPLES)
    longest = max(stretches(record.y_usable), key=lambda rows: rows.stop - rows.start, default=None)
    if longest is None or not np.any(record.u):
        return None
    return is_closed_loop(
        IoData(
            record.u[longest],
            record.y[longest],
            dt_s=record.dt_s,
            inputs=record.inputs,
            outputs=record.outputs,
        )
    )

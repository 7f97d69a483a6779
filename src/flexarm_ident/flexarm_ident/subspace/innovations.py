"""Innovations of a record: the parts of outputs and inputs that their past does not predict.

The innovations of an input are what neither its own past nor the past and present outputs predict.
They are independent of the outputs' noise, also where a controller made the input.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.subspace.feedback import BACKGROUND_SAMPLES
from flexarm_ident.subspace.gram import stretches
from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData

MEMORY = 20
"""Samples of the past that tell a signal."""
_FEWEST = 500


class Innovations(NamedTuple):
    """What the past does not tell of the outputs and of the inputs, each (rows, channels).

    The signals are in units of their deviations; the rows are those of the record.
    """

    rows: slice
    outputs: FloatArray
    inputs: FloatArray


def innovations_of(record: IoData) -> Innovations | None:
    """Return the innovations in the longest stretch of a record; None for one that is too short."""
    rows = longest(record.y_usable)
    u, y = centred(record.u[rows]), centred(record.y[rows])
    if len(u) < _FEWEST:
        return None
    past = shifted(y, 1)
    given = np.hstack([past, y[MEMORY:], shifted(u, 1)])
    later = slice(rows.start + MEMORY, rows.stop)
    return Innovations(later, remainder(past, y[MEMORY:]), remainder(given, u[MEMORY:]))


def longest(y: FloatArray) -> slice:
    """Return the rows of the longest stretch without a hole, at most as many as are looked at."""
    rows = max(stretches(y), key=lambda each: each.stop - each.start, default=slice(0, 0))
    return slice(rows.start, min(rows.stop, rows.start + BACKGROUND_SAMPLES))


def centred(signals: FloatArray) -> FloatArray:
    """Return signals less their means, in units of their deviation."""
    moved = signals - signals.mean(axis=0)
    deviation = moved.std(axis=0)
    return np.asarray(moved / np.where(deviation > 0.0, deviation, 1.0))


def shifted(signals: FloatArray, first: int) -> FloatArray:
    """Return the samples `first` to `MEMORY` rows earlier, side by side."""
    last = len(signals)
    return np.hstack([signals[MEMORY - lag : last - lag] for lag in range(first, MEMORY + 1)])


def remainder(known: FloatArray, signals: FloatArray) -> FloatArray:
    """Return what a regression on known signals leaves."""
    inverse = truncated_inverse(known.T @ known, equilibrated=True)
    return np.asarray(signals - known @ inverse.solve(known.T @ signals))

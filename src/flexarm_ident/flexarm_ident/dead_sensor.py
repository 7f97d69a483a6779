"""Stretches of a record in which a sensor was dead."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from flexarm_ident.arrays import FloatArray
    from flexarm_ident.iodata import IoData

_CONTINUOUS = 0.95
_LONGEST_HOLD = 20


def live_samples(record: IoData) -> FloatArray:
    """Return 1.0 where an output was measured and 0.0 where its sensor was dead.

    An output that changes from sample to sample, as a gauge does and an encoder does not, is dead
    where it keeps exactly one value for more than 20 samples.

    Parameters
    ----------
    record : IoData
        Record as measured; filtering hides dead sensors.

    Returns
    -------
    ndarray, (samples, outputs)
        Weights.
    """
    live = np.ones_like(record.y)
    for channel, y in enumerate(record.y.T):
        edges = np.concatenate([[0], np.flatnonzero(np.diff(y) != 0.0) + 1, [len(y)]])
        lengths = np.diff(edges)
        holds = np.flatnonzero(lengths > _LONGEST_HOLD)
        elsewhere = len(y) - lengths[holds].sum()
        if len(lengths) - len(holds) < _CONTINUOUS * elsewhere or elsewhere == 0:
            continue
        for hold in holds:
            live[edges[hold] : edges[hold + 1], channel] = 0.0
    return live

"""Stretches of a record in which a sensor was dead."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData

_CONTINUOUS = 0.95
_LONGEST_HOLD = 20
_MOSTLY = 0.5


def live_samples(record: IoData) -> FloatArray:
    """Return 1.0 where an output was measured and 0.0 in holes and where its sensor was dead.

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
    live = np.where(np.isnan(record.y_measured), 0.0, 1.0)
    for channel, y in enumerate(record.y.T):
        for rows in _holds(y):
            live[rows.start : rows.stop, channel] = 0.0
    return live


def dead_stretches(record: IoData, channel: int) -> tuple[range, ...]:
    """Return the rows in which one output was dead while the rig moved.

    A simulated rig without noise rests with all outputs constant: nothing is wrong with them.

    Parameters
    ----------
    record : IoData
        Record as measured.
    channel : int
        Number of the output.

    Returns
    -------
    tuple of range
        Stretches in which the output is dead as in `live_samples`, and another one or an input
        changes in most of the samples.
    """
    holds = _holds(record.y[:, channel])
    if not holds:
        return ()
    others = np.delete(record.y, channel, axis=1)
    moves = np.any(np.diff(np.hstack([others, record.u]), axis=0) != 0.0, axis=1)
    return tuple(rows for rows in holds if np.mean(moves[rows.start : rows.stop - 1]) > _MOSTLY)


def _holds(y: FloatArray) -> list[range]:
    """Return where a continuous signal keeps one value; nothing for one that is not continuous."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(y) != 0.0) + 1, [len(y)]])
    lengths = np.diff(edges)
    holds = np.flatnonzero(lengths > _LONGEST_HOLD)
    elsewhere = len(y) - lengths[holds].sum()
    if len(lengths) - len(holds) < _CONTINUOUS * elsewhere or elsewhere == 0:
        return []
    return [range(int(edges[hold]), int(edges[hold + 1])) for hold in holds]

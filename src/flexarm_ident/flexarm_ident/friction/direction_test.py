"""Recurrence of the errors of a model of maximum likelihood with the direction of its motion.

A linear model takes dry friction for coloured noise where the errors are not correlated with the
inputs themselves. Friction is a force against the motion, and the simulated motion knows its
direction without noise. It follows from earlier inputs, so that innovations of real noise, however
coloured and fed back, are uncorrelated with it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.friction.layout import drive_columns
from flexarm_ident.likelihood.noise_filter import is_noise, whitened
from flexarm_ident.models.state_space import simulate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.friction.layout import Drive
    from flexarm_ident.likelihood.maximum_likelihood import LikelihoodFit
    from flexarm_ident.records.iodata import IoData

# Reversals of the friction act at once; more lags only add scatter.
_LAGS = 50
# Part of the RMS speed over which the direction changes its sign: a simulation that drifts has it
# wrong where the motion is slow.
_SLOW = 0.3


def recurs_with_direction(
    fit: LikelihoodFit, records: Sequence[IoData], drives: Sequence[Drive]
) -> bool:
    """Return whether the whitened errors are correlated with the directions of earlier motion.

    Parameters
    ----------
    fit : LikelihoodFit
        Model and noise.
    records : sequence of IoData
        The records that it was fitted to.
    drives : sequence of Drive
        Outputs whose motion friction would oppose.
    """
    simulated = [
        simulate(fit.model, record.u, start) for record, start in zip(records, fit.x0, strict=True)
    ]
    pairs = list(zip(records, simulated, strict=True))
    white = [whitened(record.y_usable - y, fit.filters) for record, y in pairs]
    causes = [np.hstack([record.u, _directions(y, record, drives)]) for record, y in pairs]
    return not is_noise(white, causes, _LAGS)


def _directions(y: FloatArray, record: IoData, drives: Sequence[Drive]) -> FloatArray:
    """Return the direction of each drive's motion, -1 to 1, (samples, drives)."""
    motion = [
        y[:, column] if drive.is_speed else np.diff(y[:, column], prepend=y[0, column])
        for drive in drives
        for column in [drive_columns(record, drive)[1]]
    ]
    speed = np.stack(motion, axis=1)
    usual = np.sqrt(np.mean(speed**2, axis=0))
    part = np.divide(speed, _SLOW * usual, out=np.zeros_like(speed), where=usual > 0.0)
    return np.asarray(np.tanh(part))

"""Residuals of a free simulation: their correlation in time, and with the inputs.

A perfect model leaves the outputs' noise. Its residuals need not be white, unless the noise is, but
they are uncorrelated with the inputs of an open loop. A correlation with earlier inputs shows
dynamics that are missing, one with later inputs feedback.
Ljung, "System Identification", 2nd ed., Prentice Hall (1999), section 16.6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData

LAGS = 50
CHANCE = 0.01


@dataclass(frozen=True, eq=False)
class Residuals:
    """Correlations of the residuals, with the bounds that chance passes at one lag of a hundred.

    Attributes
    ----------
    lags : ndarray, (lags,)
        Lags of the correlation with the inputs, in samples: that of a residual with an input so
        many samples earlier.
    cross : ndarray, (lags, outputs, inputs)
        Correlation coefficients of residuals and inputs.
    cross_bound : ndarray, (outputs, inputs)
        Bounds of their magnitudes when residual and input are independent, whatever their spectra.
    own_lags : ndarray, (own lags,)
        Lags of the residuals' own correlation, from 1.
    own : ndarray, (own lags, outputs)
        Correlation coefficients of each residual with itself.
    own_bound : float
        Bound of their magnitudes when the residual is white.
    """

    lags: FloatArray
    cross: FloatArray
    cross_bound: FloatArray
    own_lags: FloatArray
    own: FloatArray
    own_bound: float

    @property
    def is_white(self) -> FloatArray:
        """Share of the lags at which each residual is within the bound of a white one."""
        return np.asarray(np.mean(np.abs(self.own) <= self.own_bound, axis=0))

    @property
    def is_independent(self) -> FloatArray:
        """Share of the earlier inputs' lags within the bound, (outputs, inputs)."""
        earlier = self.cross[self.lags > 0.0]
        return np.asarray(np.mean(np.abs(earlier) <= self.cross_bound, axis=0))


def residual_correlations(records: Sequence[IoData], simulated: Sequence[FloatArray]) -> Residuals:
    """Return the correlations of the residuals of records of one rig.

    Parameters
    ----------
    records : sequence of IoData
        Records; rows that were not measured do not count.
    simulated : sequence of ndarray, (samples, outputs)
        Simulated outputs of each record.
    """
    errors, inputs, samples = [], [], 0
    for record, y in zip(records, simulated, strict=True):
        with np.errstate(over="ignore", invalid="ignore"):
            error = record.y_usable[: len(y)] - y[: len(record)]
        samples += int(np.isfinite(error).all(axis=1).sum())
        errors.append(_centred(error))
        inputs.append(_centred(record.u[: len(error)]))
    errors, inputs = _scaled(errors), _scaled(inputs)
    lags = np.arange(-LAGS, LAGS + 1)
    own = _correlations(errors, errors).diagonal(axis1=1, axis2=2)
    cross, drive = _correlations(errors, inputs), _correlations(inputs, inputs)
    # Bartlett: what two coloured signals have in common by chance lasts.
    drive_own = drive.diagonal(axis1=1, axis2=2)
    spread = np.abs(np.einsum("li,lj->ij", own, drive_own))
    reach = float(scipy.special.ndtri(1.0 - 0.5 * CHANCE)) / np.sqrt(max(samples, 1))
    near = np.concatenate([np.arange(-LAGS, 0), np.arange(LAGS + 1)])
    return Residuals(
        lags=lags.astype(np.float64),
        cross=cross[near],
        cross_bound=reach * np.sqrt(np.maximum(spread, 1.0)),
        own_lags=np.arange(1.0, LAGS + 1.0),
        own=own[1 : LAGS + 1],
        own_bound=reach,
    )


def _centred(signals: FloatArray) -> FloatArray:
    """Return signals less their means, with zeros where they are not finite."""
    known = np.isfinite(signals)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, signals, 0.0).sum(axis=0) / count
    return np.where(known, signals - mean, 0.0)


def _scaled(signals: Sequence[FloatArray]) -> list[FloatArray]:
    """Return signals of several records by their largest values, so that no square overflows."""
    largest = np.max([np.abs(each).max(axis=0) for each in signals], axis=0)
    return [each / np.where(largest > 0.0, largest, 1.0) for each in signals]


def _correlations(late: Sequence[FloatArray], early: Sequence[FloatArray]) -> FloatArray:
    """Return correlation coefficients, (lags, late, early), of lags 0, 1, .. and, last, -1."""
    longest = max(len(each) for each in late)
    length = scipy.fft.next_fast_len(2 * longest)
    total = np.zeros((length, late[0].shape[1], early[0].shape[1]))
    for one, other in zip(late, early, strict=True):
        transforms = [scipy.fft.rfft(each, length, axis=0) for each in (one, other)]
        product = transforms[0][:, :, np.newaxis] * transforms[1].conj()[:, np.newaxis]
        total += scipy.fft.irfft(product, length, axis=0)
    power = [np.sum([np.sum(each**2, axis=0) for each in signals], 0) for signals in (late, early)]
    scale = np.sqrt(np.outer(*power))
    return np.asarray(total / np.where(scale > 0.0, scale, 1.0))

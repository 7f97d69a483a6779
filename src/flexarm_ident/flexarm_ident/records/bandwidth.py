"""How fast the outputs of a record move, and smoothing that keeps their phase."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData

_POWER_IN_BAND = 0.999
_ORDER = 2


def bandwidth_hz(records: Sequence[IoData]) -> float:
    """Return the frequency below which 99.9 % of every output's power lies."""
    highest = 0.0
    for record in records:
        frequency, power = scipy.signal.periodogram(
            record.y, 1.0 / record.dt_s, window="hann", detrend="constant", axis=0
        )
        total = np.cumsum(power, axis=0)
        inside = total < _POWER_IN_BAND * total[-1]
        highest = max(highest, float(frequency[inside.sum(axis=0).max()]))
    return highest


def smoothed(x: FloatArray, cutoff_hz: float, dt_s: float) -> FloatArray:
    """Return signals low-passed forwards and backwards, which costs no phase.

    Parameters
    ----------
    x : ndarray, (samples, channels)
        Signals.
    cutoff_hz : float
        Cut-off; signals pass as they are when it reaches 0.45 of the sampling rate.
    dt_s : float
        Sampling period.

    Returns
    -------
    ndarray, (samples, channels)
        Smoothed signals.
    """
    if cutoff_hz * dt_s >= 0.45:  # noqa: PLR2004 (of the sampling rate: nothing left to remove)
        return x
    sections = scipy.signal.butter(_ORDER, cutoff_hz, fs=1.0 / dt_s, output="sos")
    return np.asarray(scipy.signal.sosfiltfilt(sections, x, axis=0))

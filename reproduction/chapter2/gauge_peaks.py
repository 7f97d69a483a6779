"""Peaks that the modes of the arm make in the frequency response of a model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.fitting.validation import frequency_response

if TYPE_CHECKING:
    import control
    from numpy.typing import NDArray

FREQUENCIES_HZ = np.geomspace(0.5, 100.0, 400)
GAUGES = (1, 2)
CAPTURED = 0.15
"""A mode counts as captured when the model has it within this share: the thesis's own first mode of
the random waveform in Table 2-2 is 10 % off, and calls it captured."""
# Where the peak of a mode is looked for: nearer to it than to its neighbours.
_WINDOW = 1.3


def gains(model: control.StateSpace) -> NDArray[np.float64]:
    """Return the magnitudes at `FREQUENCIES_HZ`, (frequencies, 4)."""
    return np.asarray(np.abs(frequency_response(model, FREQUENCIES_HZ)[:, :, 0]))


def peak_hz(gain: NDArray[np.float64], near_hz: float) -> float:
    """Return where a response has its peak near a frequency, nan where it has none.

    Parameters
    ----------
    gain : ndarray, (frequencies,)
        Magnitudes at `FREQUENCIES_HZ`.
    near_hz
        Where to look.
    """
    is_near = (near_hz / _WINDOW < FREQUENCIES_HZ) & (near_hz * _WINDOW > FREQUENCIES_HZ)
    inside = np.flatnonzero(is_near)
    highest = inside[np.argmax(gain[inside])]
    return np.nan if highest in (inside[0], inside[-1]) else float(FREQUENCIES_HZ[highest])


def has_peak(gain: NDArray[np.float64], near_hz: float) -> bool:
    """Tell whether the response of a gauge has a peak at a frequency.

    Parameters
    ----------
    gain : ndarray, (frequencies, 4)
        Magnitudes at `FREQUENCIES_HZ`.
    near_hz
        The frequency.
    """
    return any(abs(peak_hz(gain[:, k], near_hz) / near_hz - 1.0) <= CAPTURED for k in GAUGES)

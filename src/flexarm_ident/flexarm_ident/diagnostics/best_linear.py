"""Best linear approximation from a record of a multisine, with noise and odd and even distortion.

What differs from period to period is noise. What recurs at lines that the multisine left out is the
plant's: odd distortion, such as that of dry friction, at odd lines, and even distortion, such as
that of a bent characteristic, at even ones.
Pintelon, Schoukens, "System Identification: A Frequency Domain Approach", 2nd ed., Wiley (2012),
section 4.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import DataError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flexarm_core.arrays import BoolArray, ComplexArray, FloatArray

# The first period, in which the arm settles, is left out.
_SETTLING, _FEWEST = 1, 2


@dataclass(frozen=True, eq=False)
class BestLinear:
    """Best linear approximation of a plant with one input.

    Attributes
    ----------
    frequencies_hz : ndarray, (lines,)
        Excited lines.
    response : ndarray, (lines, outputs)
        Complex gains.
    noise_level : ndarray, (outputs,)
        Root mean square of the noise of one period at a line, as a part of that at an excited line.
    odd_level, even_level : ndarray, (outputs,)
        Root mean square of the distortion of both kinds at a line, without the noise, likewise.
    """

    frequencies_hz: FloatArray
    response: ComplexArray
    noise_level: FloatArray
    odd_level: FloatArray
    even_level: FloatArray


def best_linear_approximation(
    u: ArrayLike,
    y: ArrayLike,
    *,
    dt_s: float,
    period: int,
    harmonics: NDArray[np.int64],
) -> BestLinear:
    """Return the best linear approximation from whole periods of a multisine of odd lines.

    In a closed loop the input has lines beside those of the multisine. Their linear effect is taken
    off the outputs before their distortion is looked at.

    Parameters
    ----------
    u : array_like, (samples,)
        Input.
    y : array_like, (samples, outputs)
        Outputs.
    dt_s : float
        Sampling period, s.
    period : int
        Samples of a period of the multisine, which begins in the first row.
    harmonics : ndarray of int, (lines,)
        Its lines, odd ones (`flexarm_core.waves.multisine`).

    Raises
    ------
    DataError
        If there are less than two periods behind the settling, or no odd or even line was left out.
    """
    inputs, outputs = np.asarray(u, dtype=np.float64), np.asarray(y, dtype=np.float64)
    periods = len(inputs) // period - _SETTLING
    if periods < _FEWEST:
        raise DataError(
            f"{len(inputs)} samples hold {max(periods, 0)} periods of {period} behind the "
            f"settling, and noise shows between two at least: record "
            f"{(_SETTLING + _FEWEST) * period} samples"
        )
    rows = slice(_SETTLING * period, (_SETTLING + periods) * period)
    U = _lines(inputs[rows, None], periods)
    Y = _lines(outputs[rows], periods)
    mean_u, mean_y = U.mean(axis=0), Y.mean(axis=0)
    response = mean_y[harmonics] / mean_u[harmonics]
    # Between excited lines the response is drawn straight.
    lines = np.arange(1, int(harmonics[-1]) + 1)
    between = np.stack(
        [
            np.interp(lines, harmonics, column.real) + 1j * np.interp(lines, harmonics, column.imag)
            for column in response.T
        ],
        axis=1,
    )
    rest = Y[:, lines] - between * U[:, lines]
    mean_rest = rest.mean(axis=0)
    variance = np.sum(np.abs(rest - mean_rest) ** 2, axis=0) / (periods - 1)
    size = np.sqrt(np.mean(np.abs(mean_y[harmonics]) ** 2, axis=0))

    def level(kept: BoolArray) -> FloatArray:
        if not kept.any():
            raise DataError(
                "the multisine leaves out no odd or no even line: excite odd lines, and not all"
            )
        power, noise = np.abs(mean_rest[kept]) ** 2, variance[kept] / periods
        return np.asarray(np.sqrt(np.maximum(np.mean(power - noise, axis=0), 0.0)) / size)

    excited = np.isin(lines, harmonics)
    within = lines >= harmonics[0]
    return BestLinear(
        frequencies_hz=harmonics / (period * dt_s),
        response=response,
        noise_level=np.sqrt(np.mean(variance[within], axis=0)) / size,
        odd_level=level(~excited & within & (lines % 2 == 1)),
        even_level=level(within & (lines % 2 == 0)),
    )


def _lines(signals: FloatArray, periods: int) -> ComplexArray:
    """Return the amplitudes of each period's lines, (periods, lines, channels), without drift."""
    period = len(signals) // periods
    pieces = signals.reshape(periods, period, -1)
    drift = (pieces[-1].mean(axis=0) - pieces[0].mean(axis=0)) / ((periods - 1) * period)
    even = pieces - drift * np.arange(len(signals)).reshape(periods, period, 1)
    return np.asarray(np.fft.rfft(even, axis=1) * (2.0 / period))

"""Best linear approximation from a record of a multisine, with noise and odd and even distortion.

What differs from period to period is noise. What recurs at lines that the multisine left out is the
plant's: odd distortion, such as that of dry friction, at odd lines, and even distortion, such as
that of a bent characteristic, at even ones.
Pintelon, Schoukens, "System Identification: A Frequency Domain Approach", 2nd ed., Wiley (2012),
section 4.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import scipy

from flexarm_core.errors import DataError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flexarm_core.arrays import BoolArray, ComplexArray, FloatArray

LEVEL: Final = 1e-4
"""Probability with which noise alone counts as distortion of one kind in one output."""
_FEWEST = 2


@dataclass(frozen=True, eq=False)
class Distortion:
    """Distortion of one kind in each output.

    Attributes
    ----------
    frequencies_hz : ndarray, (lines,)
        Lines that were not excited.
    amplitude : ndarray, (lines, outputs)
        Amplitude at each of them, noise included, in the unit of the output.
    level : ndarray, (outputs,)
        Root mean square at a line as a part of that at an excited line, without the noise.
    probability : ndarray, (outputs,)
        Probability that noise alone recurs as much (Fisher's method over the lines).
    """

    frequencies_hz: FloatArray
    amplitude: FloatArray
    level: FloatArray
    probability: FloatArray

    @property
    def found(self) -> BoolArray:
        """Whether there is distortion, (outputs,), at the level `LEVEL`."""
        return np.asarray(self.probability < LEVEL)


@dataclass(frozen=True, eq=False)
class BestLinear:
    """Best linear approximation of a plant with one input.

    Attributes
    ----------
    frequencies_hz : ndarray, (lines,)
        Excited lines.
    response : ndarray, (lines, outputs)
        Complex gains.
    deviation : ndarray, (lines, outputs)
        Their standard deviation by the noise.
    amplitude : ndarray, (lines, outputs)
        Amplitude of the outputs there.
    noise_level : ndarray, (outputs,)
        Root mean square of the noise of one period at a line, as a part of that at an excited line.
    odd, even : Distortion
        Distortion of both kinds.
    """

    frequencies_hz: FloatArray
    response: ComplexArray
    deviation: FloatArray
    amplitude: FloatArray
    noise_level: FloatArray
    odd: Distortion
    even: Distortion


def best_linear_approximation(
    u: ArrayLike,
    y: ArrayLike,
    *,
    dt_s: float,
    period: int,
    harmonics: NDArray[np.int64],
    settling: int = 1,
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
    settling : int
        Periods at the start that are left out, in which the arm settles.

    Raises
    ------
    DataError
        If there are less than two periods behind the settling, or no odd or even line was left out.
    """
    inputs, outputs = np.asarray(u, dtype=np.float64), np.asarray(y, dtype=np.float64)
    periods = len(inputs) // period - settling
    if periods < _FEWEST:
        raise DataError(
            f"{len(inputs)} samples hold {max(periods, 0)} periods of {period} behind the "
            f"settling, and noise shows between two at least: record "
            f"{(settling + _FEWEST) * period} samples"
        )
    rows = slice(settling * period, (settling + periods) * period)
    U = _lines(inputs[rows, None], periods)
    Y = _lines(outputs[rows], periods)
    mean_u, mean_y = U.mean(axis=0), Y.mean(axis=0)
    response = mean_y[harmonics] / mean_u[harmonics]
    at_hz = np.arange(len(mean_u)) / (period * dt_s)
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
    deviation = np.sqrt(variance[harmonics - 1] / periods) / np.abs(mean_u[harmonics])

    def distortion(kept: BoolArray) -> Distortion:
        if not kept.any():
            raise DataError(
                "the multisine leaves out no odd or no even line: excite odd lines, and not all"
            )
        power, noise = np.abs(mean_rest[kept]) ** 2, variance[kept] / periods
        return Distortion(
            at_hz[lines[kept]],
            np.sqrt(power),
            np.sqrt(np.maximum(np.mean(power - noise, axis=0), 0.0)) / size,
            _probability(power / noise, periods),
        )

    excited = np.isin(lines, harmonics)
    within = lines >= harmonics[0]
    return BestLinear(
        frequencies_hz=at_hz[harmonics],
        response=response,
        deviation=deviation,
        amplitude=np.abs(mean_y[harmonics]),
        noise_level=np.sqrt(np.mean(variance[within], axis=0)) / size,
        odd=distortion(~excited & within & (lines % 2 == 1)),
        even=distortion(within & (lines % 2 == 0)),
    )


def _lines(signals: FloatArray, periods: int) -> ComplexArray:
    """Return the amplitudes of each period's lines, (periods, lines, channels), without drift."""
    period = len(signals) // periods
    pieces = signals.reshape(periods, period, -1)
    drift = (pieces[-1].mean(axis=0) - pieces[0].mean(axis=0)) / ((periods - 1) * period)
    even = pieces - drift * np.arange(len(signals)).reshape(periods, period, 1)
    return np.asarray(np.fft.rfft(even, axis=1) * (2.0 / period))


def _probability(ratios: FloatArray, periods: int) -> FloatArray:
    """Return the probability that noise has such powers of means, in units of their variances.

    Each ratio is distributed as F with 2 and 2 (periods - 1) degrees of freedom, whatever the
    noise's colour. Fisher, "Statistical Methods for Research Workers", section 21.1.
    """
    free = periods - 1
    logarithms = free * np.log1p(ratios / free)
    return np.asarray(scipy.special.gammaincc(len(ratios), logarithms.sum(axis=0)))

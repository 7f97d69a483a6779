"""Whiteness test of the outputs' noise, on the eigenvalues of a range space.

ORSE's eigenvectors beyond the model's order span directions that contain noise only. If the noise
is white and the outputs are scaled by it, all their eigenvalues are equal; colour spreads them. The
spread is that of the test of sphericity: John, "Some optimal multivariate tests", Biometrika 58
(1971); Ledoit and Wolf, "Some hypothesis tests for the covariance matrix when the dimension is
large compared to the sample size", Annals of Statistics 30 (2002).

Rows of a Hankel matrix repeat each other. The spread of N eigenvalues is then a weighted sum of
the squared correlations at all lags below q and of all pairs of outputs, each with variance 1 / d.
For white noise its mean is N / d, and its standard deviation sqrt(8 q / 3) / d.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from flexarm_ident.subspace.orse import RangeSpace

_DEVIATIONS = 6.0
# The scaling is estimated as well, and a spread as small has no visible effect on a model.
_TOLERATED = 0.01
# Noise power in units of the innovation's; less is rounding.
_SMALLEST_NOISE = 1e-2


@dataclass(frozen=True)
class WhitenessTest:
    """Outcome of the test.

    Attributes
    ----------
    spread : float
        Variance of the noise eigenvalues, in units of their squared mean; 0 without noise.
    expected : float
        Mean spread of white noise.
    limit : float
        Spread that white noise exceeds by chance only, with six standard deviations.
    white : bool
        Whether the noise passes for white; true when there is none.
    """

    spread: float
    expected: float
    limit: float
    white: bool


def whiteness_test(space: RangeSpace, columns: int, order: int) -> WhitenessTest:
    """Test the noise of outputs scaled by their innovation, given ORSE's range space of them.

    `columns` is d of (2-19). The eigenvalues beyond the model's order are taken for noise, and half
    of them in any case.
    """
    values = space.singular_values
    size = len(values)
    noise = values[min(order, size // 2) :]
    expected = size / columns
    limit = expected + _DEVIATIONS * np.sqrt(8.0 * space.block_rows / 3.0) / columns + _TOLERATED
    mean = float(noise.mean())
    if mean < _SMALLEST_NOISE:
        return WhitenessTest(0.0, expected, float(limit), white=True)
    spread = float(noise.var()) / mean**2
    return WhitenessTest(spread, expected, float(limit), white=spread <= limit)

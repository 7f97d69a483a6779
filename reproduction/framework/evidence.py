"""What many seeds say: tests of a claim, and figures with their scatter."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy import stats

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

Figures: TypeAlias = "Sequence[float] | NDArray[np.float64] | NDArray[np.int_]"
"""A figure of many runs, one per seed."""

SEEDS = tuple(range(1, 21))
"""Of the runs that a claim or a scatter rests on."""
OFTEN = 0.5
"""What happens in more than this share of the seeds happens in most of them."""
LEVEL = 0.05
"""A claim holds when chance alone would bear it out as often in fewer than 5 % of all cases."""


def sign_test(smaller: Figures, larger: Figures) -> float:
    """Return how probable it is that chance makes as many pairs come out in this order.

    The exact one-sided sign test; ties count against the claim.

    Parameters
    ----------
    smaller, larger : sequence of float
        Figures of the same runs; the claim is that the first is the smaller one.

    Raises
    ------
    ValueError
        When they are not equally many.
    """
    wins = sum(bool(a < b) for a, b in zip(smaller, larger, strict=True))
    return float(stats.binomtest(wins, len(smaller), alternative="greater").pvalue)


def p_text(p_value: float) -> str:
    """Return a p-value as text."""
    return f"p = {p_value:.2g}" if p_value >= 1e-4 else "p < 0.0001"  # noqa: PLR2004


def spread(values: Figures, form: str = ".3f") -> str:
    """Return median and range of a figure over the seeds, as text."""
    low, middle, high = np.quantile(np.asarray(values), (0.0, 0.5, 1.0)).tolist()
    return f"{middle:{form}} ({low:{form}} to {high:{form}})"

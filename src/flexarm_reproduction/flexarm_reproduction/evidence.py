"""What many seeds say: tests of a claim, and figures with their scatter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

if TYPE_CHECKING:
    from collections.abc import Sequence

LEVEL = 0.05
"""A claim holds when chance alone would bear it out as often in fewer than 5 % of all cases."""


def sign_test(smaller: Sequence[float], larger: Sequence[float]) -> float:
    """Return how probable it is that chance makes as many pairs come out in this order.

    The exact one-sided sign test; ties count against the claim.
    """
    wins = sum(a < b for a, b in zip(smaller, larger, strict=True))
    return float(stats.binomtest(wins, len(smaller), alternative="greater").pvalue)


def p_text(p_value: float) -> str:
    """Return a p-value as text."""
    return f"p = {p_value:.2g}" if p_value >= 1e-4 else "p < 0.0001"  # noqa: PLR2004


def spread(values: Sequence[float], form: str = ".3f") -> str:
    """Return median and range of a figure over the seeds, as text."""
    low, middle, high = np.quantile(np.asarray(values), (0.0, 0.5, 1.0)).tolist()
    return f"{middle:{form}} ({low:{form}} to {high:{form}})"

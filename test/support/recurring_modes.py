"""Modes that recur over the orders, by their frequencies."""

from __future__ import annotations

import numpy as np

from flexarm_ident.diagnostics.stabilisation import RecurringMode
from flexarm_ident.estimation.physical_modes import JudgedMode


def judged(
    frequency_hz: float,
    *,
    scatter_hz: float = 0.02,
    damping_scatter: float = 0.004,
    physical: bool = True,
) -> JudgedMode:
    """Return a mode that three of five orders have."""
    mode = RecurringMode(
        frequency_hz=frequency_hz,
        damping_ratio=0.0412345,
        frequency_std_hz=scatter_hz,
        damping_std=damping_scatter,
        count=3,
        share=0.6,
        orders=(7, 8, 9),
        frequencies_hz=(frequency_hz,) * 3,
        shape=np.ones(4, dtype=complex),
    )
    return JudgedMode(mode, 0.266, physical)


NEIGHBOURS = [judged(9.107), judged(43.25), judged(45.36), judged(50.0, physical=False)]
"""Two of the plant's, one of which high orders split, and the mains."""

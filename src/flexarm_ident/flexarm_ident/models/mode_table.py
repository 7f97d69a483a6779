"""Table of modes, as a notebook shows it."""

from __future__ import annotations

from itertools import zip_longest
from typing import TYPE_CHECKING

from flexarm_core.labels import decay, with_deviation
from flexarm_core.showing.tables import html_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.models.modes import Mode, ModeUncertainty

_HEADER = ("states", "frequency, Hz", "damping", "MRM", "rank", "MSV", "rank", "kept")


def mode_table(
    title: str, modes: Sequence[Mode], dt_s: float, deviations: Sequence[ModeUncertainty] = ()
) -> str:
    """Return modes by rising frequency in HTML, as Tables 3-1a to 3-3a.

    Real modes have their time constant in its place.

    Parameters
    ----------
    title : str
        Caption.
    modes : sequence of Mode
        Modes.
    dt_s : float
        Sampling period.
    deviations : sequence of ModeUncertainty
        Their standard deviations in the same order; none when they are not known.
    """
    known = sorted(zip_longest(modes, deviations), key=lambda each: each[0].frequency_hz)
    rows = [
        (
            mode.label,
            decay(mode.eigenvalue, dt_s)
            or with_deviation(mode.frequency_hz, spread and spread.frequency_std_hz),
            with_deviation(mode.damping_ratio, (spread and spread.damping_std) or None, decimals=4),
            f"{mode.mrm:.4g}",
            str(mode.mrm_rank),
            f"{mode.msv:.4g}",
            str(mode.msv_rank),
            "yes" if mode.kept else "no",
        )
        for mode, spread in known
    ]
    return html_table(title, _HEADER, rows)

"""The appendices of the thesis, and the figures of chapter 2 that show signals only."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_reproduction import (
    catalogue_tables,
    excitation_figures,
    nominal_models,
    strain_sign,
)

if TYPE_CHECKING:
    from flexarm_reproduction.subjects import Subject

SUBJECTS: tuple[Subject, ...] = (
    *excitation_figures.SUBJECTS,
    *catalogue_tables.SUBJECTS,
    *strain_sign.SUBJECTS,
    *nominal_models.SUBJECTS,
)
"""Tables A-1 to A-4, Appendix B, Figures 2-2, 2-5 and 2-10."""

"""The appendices of the thesis, and the figures of chapter 2 that show signals only."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reproduction.appendices import catalogue_tables, nominal_models, strain_sign
from reproduction.chapter2 import excitation_figures

if TYPE_CHECKING:
    from reproduction.framework.subjects import Subject

SUBJECTS: tuple[Subject, ...] = (
    *excitation_figures.SUBJECTS,
    *catalogue_tables.SUBJECTS,
    *strain_sign.SUBJECTS,
    *nominal_models.SUBJECTS,
)
"""Tables A-1 to A-4, Appendix B, Figures 2-2, 2-5 and 2-10."""

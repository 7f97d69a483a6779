"""Contents of the study: every subject, in the order of the thesis."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reproduction.appendices import experiments, nominal_models, strain_sign
from reproduction.calibration import sensitivity
from reproduction.chapter2 import (
    claims,
    excitation,
    imperfections,
    modes,
    sampling_rates,
    tables,
    thesis_way,
    validation,
)
from reproduction.chapter3 import claims as reduction_claims
from reproduction.chapter3 import costs, figures, ranks, responses, updated_models
from reproduction.chapter4 import ilqr, ilqr_claims, ilqr_designs, pdp, pdpc, pi
from reproduction.framework.selection import in_order

if TYPE_CHECKING:
    from reproduction.framework.findings import Subject

_MODULES = (
    *(excitation, tables, modes, validation, claims, imperfections),
    *(sampling_rates, thesis_way),
    *(ranks, costs, updated_models, figures, responses, reduction_claims),
    *(pi, pdp, pdpc, ilqr, ilqr_claims, ilqr_designs),
    *(experiments, strain_sign, nominal_models, sensitivity),
)


def all_subjects() -> tuple[Subject, ...]:
    """Return every subject, see `in_order`."""
    return in_order([subject for module in _MODULES for subject in module.SUBJECTS])

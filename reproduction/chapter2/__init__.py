"""Chapter 2: models from open-loop, bounded and closed-loop experiments."""

from __future__ import annotations

from reproduction.chapter2 import (
    closed_loop_response,
    imperfection_claim,
    model_validation,
    preparation_claim,
    rate_claim,
    singular_value_order,
    special_models,
    survey_claims,
    survey_tables,
    waveform_modes,
)

SUBJECTS = (
    *survey_tables.SUBJECTS,
    *waveform_modes.SUBJECTS,
    *special_models.SUBJECTS,
    *singular_value_order.SUBJECTS,
    *model_validation.SUBJECTS,
    *closed_loop_response.SUBJECTS,
    *survey_claims.SUBJECTS,
    *imperfection_claim.SUBJECTS,
    *preparation_claim.SUBJECTS,
    *rate_claim.SUBJECTS,
)

"""Chapter 3: models reduced by MRM, MSV and MRMC, and updated."""

from __future__ import annotations

from reproduction.chapter3 import (
    ranking_claims,
    reduction_errors,
    reduction_figures,
    reduction_models,
    reduction_ranks,
    reduction_responses,
    updating_claims,
)

SUBJECTS = (
    *reduction_ranks.SUBJECTS,
    *reduction_errors.SUBJECTS,
    *reduction_models.SUBJECTS,
    *reduction_figures.SUBJECTS,
    *reduction_responses.SUBJECTS,
    *ranking_claims.SUBJECTS,
    *updating_claims.SUBJECTS,
)

"""Chapter 4: models judged by their controllers, PDPC and ILQR."""

from __future__ import annotations

from reproduction.chapter4 import (
    ilqr_claims,
    ilqr_runs,
    margin_claim,
    pdp_design,
    pdpc_claims,
    pdpc_runs,
    pi_findings,
)

SUBJECTS = (
    *pi_findings.SUBJECTS,
    *pdp_design.SUBJECTS,
    *margin_claim.SUBJECTS,
    *pdpc_runs.SUBJECTS,
    *pdpc_claims.SUBJECTS,
    *ilqr_runs.SUBJECTS,
    *ilqr_claims.SUBJECTS,
)

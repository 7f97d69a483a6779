"""The claims of section 3.3 on how modes are chosen: items 1 and 4."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from reproduction.chapter3.reduction_calls import errors_text, means
from reproduction.chapter3.reduction_claims import NOISES, claim_subject
from reproduction.framework.evidence import LEVEL, p_text, sign_test
from reproduction.framework.findings import Finding, SideBySide, judged

if TYPE_CHECKING:
    from reproduction.chapter3.reduction_claims import Trials
    from reproduction.chapter3.reduction_stages import ReductionTrial

RIGID_STATES = 2
"""Section 3.2: the rigid motion takes two states or three."""


def claim_mrm(found: Trials) -> Finding:
    """Tell whether MRM's models are better than MSV's of as many states.

    Parameters
    ----------
    found
        Our results by example and noise.
    """
    rows, held, ordered = [], [], []
    for (code, noise), some in found.items():
        mrm, msv = means(some, "mrm"), means(some, "msv")
        p_value = sign_test(mrm, msv)
        held.append(p_value < LEVEL)
        ordered.append(bool(np.median(mrm) < np.median(msv)))
        rows.append(
            (
                code,
                NOISES[noise],
                errors_text(mrm),
                errors_text(msv),
                f"{int((mrm < msv).sum())} of {len(some)}",
                p_text(p_value),
            )
        )
    fails = [
        f"{code} with {noise} noise"
        for (code, noise, *_), is_so in zip(rows, held, strict=True)
        if not is_so
    ]
    return Finding(
        judged(
            agrees=all(held),
            same_ranking=all(ordered),
            evidence=f"MRM's model is better than MSV's at p < {LEVEL:g} in {sum(held)} of "
            f"{len(held)} cases: five models, two kinds of records."
            + (f" It does not hold for {', '.join(fails)}." if fails else ""),
            reason="MSV measures the response to a pulse, in which slow modes hardly show; where "
            "they do show, MSV keeps them and loses nothing.",
        ),
        tables=(
            SideBySide(
                "Mean error by data matching, median and range over the records",
                ("model", "noise", "MRM", "MSV", "MRM is better in", "sign test"),
                tuple(rows),
            ),
        ),
        text=(
            (
                "Each full model is reduced by both rankings to as many states as the thesis "
                "keeps; none is updated. A model has one state more where a pair would have to be "
                "split."
            ),
        ),
    )


def claim_mrmc(found: Trials) -> Finding:
    """Tell which rankings keep both the rigid motion and the bending modes.

    Parameters
    ----------
    found
        Our results by example and noise.
    """
    rows, totals = [], dict.fromkeys(("mrm", "msv", "mrmc"), 0)
    nearest = 0
    for (code, noise), some in found.items():
        counts = {way: sum(keeps_both(trial, way) for trial in some) for way in totals}
        nearest += sum(set(trial.bending) <= set(trial.stages["mrmc"].kept) for trial in some)
        totals = {way: totals[way] + counts[way] for way in totals}
        rows.append(
            (code, NOISES[noise], *(f"{count} of {len(some)}" for count in counts.values()))
        )
    records = sum(len(some) for some in found.values())
    return Finding(
        judged(
            agrees=totals["mrmc"] == records,
            same_ranking=totals["mrmc"] > max(totals["mrm"], totals["msv"]),
            evidence=f"Both are kept in {totals['mrmc']} of {records} models by MRMC, in "
            f"{totals['mrm']} by MRM and in {totals['msv']} by MSV. The very pairs that are "
            f"nearest to the arm's frequencies are among MRMC's in {nearest}.",
            reason="MRMC keeps no more than the other rankings.",
        ),
        tables=(
            SideBySide(
                "Reduced models that have all bending modes of their full model and at least "
                f"{RIGID_STATES} states of the rigid motion",
                ("model", "noise", *(way.upper() for way in totals)),
                tuple(rows),
            ),
        ),
        text=(
            (
                "A bending mode that the full model does not have cannot be kept: as many have to "
                "be there as the full model has, looked for as in Table 3-1a. MRMC does so by its "
                "construction, though it may take a stronger pair than the nearest; the other two "
                "show what it is good for."
            ),
        ),
    )


def has_bending(trial: ReductionTrial, way: str) -> bool:
    """Whether a reduced model has as many bending modes as its full model."""
    return len(trial.stages[way].bending_hz) >= len(trial.bending)


def keeps_both(trial: ReductionTrial, way: str) -> bool:
    """Whether a reduced model has those and enough states of the rigid motion."""
    rigid = {*trial.stages[way].kept} & {*trial.rigid}
    states = sum(len(mode.states) for mode in trial.modes if mode.label in rigid)
    return has_bending(trial, way) and states >= RIGID_STATES


SUBJECTS = (
    claim_subject(1, "MRM ranks modes more reliably than MSV", claim_mrm),
    claim_subject(4, "MRMC keeps both rigid and flexible modes", claim_mrmc),
)

"""The claims of section 3.3 on updating: items 2 and 3."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from reproduction.chapter3.reduction_calls import INITIAL, Validation, errors_text, means
from reproduction.chapter3.reduction_claims import NOISES, claim_subject
from reproduction.chapter3.reduction_stages import C_UPDATED
from reproduction.framework.evidence import LEVEL, p_text, sign_test
from reproduction.framework.findings import Finding, SideBySide, judged

if TYPE_CHECKING:
    from reproduction.chapter3.reduction_claims import Trials
    from reproduction.chapter3.reduction_stages import ReductionTrial

STABLE, UNSTABLE = "Ac3_18", "Ac3_21u"
KINDS: tuple[Validation, ...] = ("dmv", "sfv")
UPDATES = {"updated": "mrmc", "updated_mrmc": "mrmc", "updated_msv": "msv"}
"""What each update starts from; `updated` of Ac11_26 starts from MRM."""


def claim_update(found: Trials) -> Finding:
    """Tell whether an update makes a reduced model better, and how often better than the full one.

    Parameters
    ----------
    found
        Our results by example and noise.
    """
    rows, fails, better = [], [], {"B": 0, "C": 0}
    updates = 0
    apart = []
    for (code, noise), some in found.items():
        full = means(some, INITIAL)
        for stage in UPDATES:
            if stage not in some[0].stages:
                continue
            start = start_of(some[0], stage)
            before, after = means(some, start), means(some, stage)
            p_value = sign_test(after, before)
            by_c = means(some, stage + C_UPDATED)
            counts = {"B": int((after < full).sum()), "C": int((by_c < full).sum())}
            rows.append(
                (
                    code,
                    NOISES[noise],
                    start.upper(),
                    f"{np.median(before / full):.2f}",
                    f"{np.median(after / full):.2f}",
                    p_text(p_value),
                    f"{np.median(by_c / full):.2f}",
                    f"{counts['B']} / {counts['C']} of {len(some)}",
                )
            )
            if start == "msv":
                apart.append(after / means(some, "updated"))
                continue
            updates += 1
            better = {matrix: better[matrix] + counts[matrix] for matrix in better}
            if p_value >= LEVEL:
                fails.append(f"{code} with {NOISES[noise]} noise ({p_text(p_value)})")
    records = sum(len(some) for some in found.values())
    ratios = np.exp(np.mean(np.log(apart), axis=0))
    condition = sign_test([1.0] * len(ratios), ratios.tolist())
    return Finding(
        judged(
            agrees=not fails and max(better.values()) > 0,
            same_ranking=len(fails) < updates / 2,
            evidence=f"The update makes the model better at p < {LEVEL:g} in "
            f"{updates - len(fails)} of {updates} cases"
            + (f", not in {', '.join(fails)}" if fails else "")
            + f". It ends below the full model {better['B']} times when B is updated and "
            f"{better['C']} times when C is, of {updates * records // len(found)}. "
            f"Updated, MSV's models have {np.median(ratios):.2f} times the error of the others "
            f"({p_text(condition)}).",
            reason="An update by least squares cannot be worse on the samples that it is fitted "
            "to, only on the others.",
        ),
        tables=(
            SideBySide(
                "Mean error by data matching as part of the full model's, medians",
                (
                    "model",
                    "noise",
                    "modes by",
                    "reduced",
                    "B updated",
                    "sign test",
                    "C updated",
                    "better than full, B / C",
                ),
                tuple(rows),
            ),
        ),
        text=(
            (
                "Updates are fitted to the first half of a record, the error is over the whole of "
                "it. The sign test is of the update of B against the reduced model. Models by MSV "
                "are updated too, to see whether the update needs the main modes: they do not "
                "count in the verdict."
            ),
        ),
    )


def start_of(trial: ReductionTrial, stage: str) -> str:
    """Return the stage whose modes an updated one has."""
    if stage == "updated" and "updated_mrmc" in trial.stages:
        return "mrm"
    return UPDATES[stage]


def claim_unstable(found: Trials) -> Finding:
    """Tell whether an updated model from a stable one is better than one from an unstable one.

    Parameters
    ----------
    found
        Our results of `STABLE` and `UNSTABLE` by noise, of the same records.
    """
    rows, p_values, lower = [], {}, []
    for noise, words in NOISES.items():
        for kind in KINDS:
            stable, unstable = (
                means(found[code, noise], "updated", kind) for code in (STABLE, UNSTABLE)
            )
            p_value = p_values[noise, kind] = sign_test(stable, unstable)
            lower.append(bool(np.median(stable) < np.median(unstable)))
            rows.append(
                (
                    kind.upper(),
                    words,
                    errors_text(stable),
                    errors_text(unstable),
                    f"{int((stable < unstable).sum())} of {len(stable)}",
                    p_text(p_value),
                )
            )
    applied = [
        trial.stages["updated"].dmv_mean < trial.stages["mrmc"].dmv_mean
        for noise in NOISES
        for trial in found[UNSTABLE, noise]
    ]
    held = [key for key, value in p_values.items() if value < LEVEL]
    return Finding(
        judged(
            agrees=all(applied) and len(held) == len(p_values),
            same_ranking=all(applied) and all(lower),
            evidence=f"The update makes the model from an unstable one better in {sum(applied)} of "
            f"{len(applied)} records. The one from a stable model is more accurate at "
            f"p < {LEVEL:g} in {len(held)} of {len(p_values)} comparisons: "
            + ", ".join(
                f"{kind.upper()} with {NOISES[noise]} noise {p_text(value)}"
                for (noise, kind), value in p_values.items()
            )
            + ".",
            reason="Moving the eigenvalue costs the position, which drifts when it is simulated on "
            "its own: data matching with strong noise shows that. In the loop of set-point "
            "following the law holds the position. That these models have a state more may be why "
            "they come out ahead; it was not tested.",
        ),
        tables=(
            SideBySide(
                "Mean errors of the updated models, of the same records",
                (
                    "by",
                    "noise",
                    f"from {STABLE}",
                    f"from {UNSTABLE}",
                    "from the stable one is better in",
                    "sign test",
                ),
                tuple(rows),
            ),
        ),
        text=(
            (
                "Both models come from C_dat3: the stable one has 18 states and 10 when reduced, "
                "the unstable one 21, or the nearest order with one slow unstable eigenvalue, and "
                "11."
            ),
        ),
    )


SUBJECTS = (
    claim_subject(2, "Updating makes a reduced model accurate again", claim_update),
    claim_subject(
        3,
        "The procedure takes unstable models too; stable ones come out better",
        claim_unstable,
        (STABLE, UNSTABLE),
    ),
)

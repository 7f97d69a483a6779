"""Choice 2-2: the thesis's way to identify beside ours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.estimation.pipeline import identify
from flexarm_ident.fitting.output_fit import fit_inputs
from flexarm_ident.fitting.validation import validate_dmv
from flexarm_ident.models.state_space import is_stable, stabilise, state_space
from flexarm_ident.subspace.orse import innovation_scaled
from reproduction.chapter2.order_survey import (
    CRITICAL_RADIUS,
    ORDERS,
    fitted_half,
    identified,
    matched,
    printed_order,
    stability,
    thesis_record,
)
from reproduction.framework.findings import SEEDS, Call, Finding, SideBySide, prose, subject
from reproduction.framework.verdicts import Judgement, Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flexarm_ident import IoData
    from flexarm_ident.fitting.validation import Dmv
    from flexarm_ident.models.state_space import Way
    from flexarm_ident.subspace.subspace_protocol import Subspace
    from reproduction.framework.findings import Results

RECORDS = ("O_dat2", "B_dat9", "C_dat3", "C_dat11")
"""Records that the later chapters use."""
_SEEDS = SEEDS[:10]
THESIS_WAY = "the thesis's way"


@dataclass(frozen=True)
class Ways:
    """Errors of the model of the printed order, by what is done in another way than the thesis's.

    `errors` has mean and position error by data matching; `strict` and `critical` are the numbers
    of orders that are stable, without and with the critically stable ones.
    """

    errors: Mapping[str, tuple[float, float]]
    strict: int
    critical: int


def ways(record: str, seed: int) -> Ways:
    """Identify the model of the printed order in the thesis's way, and in ours."""
    whole = thesis_record(record, seed)
    half = fitted_half(whole)
    found = identified(half)
    order = printed_order(record)
    ours = identify(half, order=order, method="orse")
    errors = {
        THESIS_WAY: _matching(found.subspace, order, half, whole),
        "unstable eigenvalues mirrored": _matching(
            found.subspace, order, half, whole, way="mirror"
        ),
        "initial state fitted, outputs weighted by their power": _matching(
            found.subspace, order, half, whole, at_rest=False
        ),
        "outputs scaled by their innovation": _matching(
            innovation_scaled(found.gram), order, half, whole
        ),
        f"all in our way, q = {ours.block_rows}": _mean_and_position(
            validate_dmv(ours.model, whole)
        ),
    }
    strict = sum(is_stable(found.subspace.matrices(each).A) for each in ORDERS)
    return Ways(errors, strict, int(stability(found).sum()))


def _matching(
    subspace: Subspace,
    order: int,
    half: IoData,
    whole: IoData,
    *,
    way: Way = "clamp",
    at_rest: bool = True,
) -> tuple[float, float]:
    raw = subspace.matrices(order)
    A, _ = stabilise(raw.A, way)
    fit = fit_inputs(A, raw.C, [half], at_rest=at_rest)
    model = state_space(
        *(A, fit.B, raw.C, fit.D, half.dt_s), inputs=half.inputs, outputs=half.outputs
    )
    return _mean_and_position(matched(model, whole) if at_rest else validate_dmv(model, whole))


def _mean_and_position(found: Dmv) -> tuple[float, float]:
    return found.mean, float(found.delta[0])


def _ways(results: Results) -> Finding:
    found = {record: [results[Call(ways, (record, seed))] for seed in _SEEDS] for record in RECORDS}
    first = next(iter(found.values()))
    medians = {
        way: {
            record: np.median([each.errors[way] for each in some], axis=0).tolist()
            for record, some in found.items()
        }
        for way in first[0].errors
    }
    return Finding(
        ways_judgement({way: [mean for mean, _ in each.values()] for way, each in medians.items()}),
        (
            SideBySide(
                f"Mean and position error by data matching, printed order, {len(_SEEDS)} seeds",
                ("changed", *RECORDS),
                tuple(
                    (way, *(f"{mean:.3f}, {position:.3f}" for mean, position in each.values()))
                    for way, each in medians.items()
                ),
            ),
            SideBySide(
                f"Stable orders of {len(ORDERS)}, mean over the seeds",
                ("counted", *RECORDS),
                tuple(
                    (
                        which,
                        *(
                            f"{np.mean([getattr(each, which) for each in some]):.1f}"
                            for some in found.values()
                        ),
                    )
                    for which in ("strict", "critical")
                ),
            ),
        ),
        text=(prose("choice-2-2.text", radius=CRITICAL_RADIUS),),
    )


def ways_judgement(means: Mapping[str, Sequence[float]]) -> Judgement:
    """Say by how much each of our ways changes the mean error, on the average of the records."""
    thesis = np.array(means[THESIS_WAY])
    changes = ", ".join(
        f"{way} {np.mean(np.array(each) / thesis - 1.0):+.0%}"
        for way, each in means.items()
        if way != THESIS_WAY
    )
    return Judgement(
        Verdict.OURS, f"The study takes the thesis's way. The mean error with another: {changes}."
    )


SUBJECTS = (
    subject(
        "choice-2-2",
        tuple(Call(ways, (record, seed)) for record in RECORDS for seed in _SEEDS),
        _ways,
    ),
)

"""Claims 3-1 to 3-4: the choice of the modes, and the update (section 3.3)."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from reproduction.chapter3.examples import (
    C_UPDATED,
    EXAMPLES,
    INITIAL,
    LOW,
    MEANING,
    TABLES,
    THESIS,
    Validation,
    thesis_rows,
)
from reproduction.chapter3.trial import both_calls, errors, errors_text, means, trials
from reproduction.framework.findings import (
    Finding,
    SideBySide,
    Subject,
    columns,
    prose,
    subject,
    thesis_table,
)
from reproduction.framework.verdicts import (
    LEVEL,
    Statement,
    all_of,
    exactly,
    judged,
    less,
    mostly,
    p_text,
    sign_test,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from reproduction.chapter3.examples import ReductionTrial
    from reproduction.framework.findings import Results


CODES = tuple(TABLES.values())
"""Examples that claims are tested on."""
NOISES: Mapping[str, str] = MappingProxyType({THESIS: "strong", LOW: "little"})
Trials: TypeAlias = "Mapping[tuple[str, str], Sequence[ReductionTrial]]"
"""Results by example and noise."""


def claim_subject(
    number: int, claim: Callable[[Trials], Finding], codes: Sequence[str] = CODES
) -> Subject:
    """Return a claim of section 3.3 as a subject; `claim` tests it on the results of `codes`."""

    def build(results: Results) -> Finding:
        return claim(
            {(code, noise): trials(results, code, noise) for code in codes for noise in NOISES}
        )

    needs = tuple(call for code in codes for call in both_calls(code))
    return subject(f"claim-3-{number}", needs, build)


RIGID_STATES = 2
"""Section 3.2: the rigid motion takes two states or three."""


def claim_mrm(found: Trials) -> Finding:
    """Tell whether MRM's models are better than MSV's of as many states."""
    rows, better = [], {}
    for (code, noise), some in found.items():
        mrm, msv = means(some, "mrm"), means(some, "msv")
        better[code, noise] = less(f"MRM's model of {code} is better than MSV's", mrm, msv)
        rows.append(
            (
                code,
                NOISES[noise],
                errors_text(mrm),
                errors_text(msv),
                f"{int((mrm < msv).sum())} of {len(some)}",
                p_text(better[code, noise].p_value),
            )
        )
    quiet = [each.holds for (_, noise), each in better.items() if noise == LOW]
    return Finding(
        judged(
            statements=[each for (_, noise), each in better.items() if noise == THESIS],
            evidence=f"With little noise it holds of {sum(quiet)} of {len(quiet)} models.",
            reason=prose("claim-3-1.reason"),
        ),
        tables=(
            SideBySide(
                "Mean error by data matching, median and range over the records",
                ("model", "noise", "MRM", "MSV", "MRM is better in", "sign test"),
                tuple(rows),
            ),
        ),
        text=(prose("claim-3-1.text"),),
    )


def claim_mrmc(found: Trials) -> Finding:
    """Tell which rankings keep both the rigid motion and the bending modes."""
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
            statements=(
                exactly("MRMC keeps both kinds of modes", holds=totals["mrmc"] == records),
            ),
            evidence=f"Both are kept in {totals['mrmc']} of {records} models by MRMC, in "
            f"{totals['mrm']} by MRM and in {totals['msv']} by MSV. The very pairs that are "
            f"nearest to the arm's frequencies are among MRMC's in {nearest}.",
            reason="MRMC keeps no more than the other rankings.",
            by_construction=True,
        ),
        tables=(
            SideBySide(
                prose("claim-3-4.table", rigid_states=RIGID_STATES),
                ("model", "noise", *(way.upper() for way in totals)),
                tuple(rows),
            ),
        ),
        text=(prose("claim-3-4.text"),),
    )


def has_bending(trial: ReductionTrial, way: str) -> bool:
    """Return whether a reduced model has as many bending modes as its full model."""
    return len(trial.stages[way].bending_hz) >= len(trial.bending)


def keeps_both(trial: ReductionTrial, way: str) -> bool:
    """Return whether a reduced model has those and enough states of the rigid motion."""
    rigid = {*trial.stages[way].kept} & {*trial.rigid}
    states = sum(len(mode.states) for mode in trial.modes if mode.label in rigid)
    return has_bending(trial, way) and states >= RIGID_STATES


STABLE, UNSTABLE = "Ac3_18", "Ac3_21u"
LEVEL_STATES = "level"
"""Stage of the unstable example with as many states as the updated stable one."""
KINDS: tuple[Validation, ...] = ("dmv", "sfv")
UPDATES = {"updated": "mrmc", "updated_mrmc": "mrmc", "updated_msv": "msv"}
"""Stage that each update starts from; `updated` of Ac11_26 starts from MRM."""


def _beats_full(number: str) -> bool:
    rows = thesis_rows(thesis_table(f"table_{number.replace('-', '_')}b"))
    printed = {row.stage: row.mean for row in rows if row.validation == "dmv"}
    return printed["updated"] < printed[INITIAL]


BETTER_THAN_FULL = tuple(code for number, code in TABLES.items() if _beats_full(number))
"""Models whose update, of B, has the smaller error than the full model in the thesis's tables."""


def claim_update(found: Trials) -> Finding:
    """Tell whether an update makes a reduced model better, and even better than the full one."""
    rows, apart, better = [], [], []
    helps: dict[tuple[str, str], list[Statement]] = {}
    for (code, noise), some in found.items():
        full = means(some, INITIAL)
        for stage in UPDATES:
            if stage not in some[0].stages:
                continue
            start = start_of(some[0], stage)
            before, after = means(some, start), means(some, stage)
            by_c = means(some, stage + C_UPDATED)
            update = less(start.upper(), after, before)
            rows.append(
                (
                    code,
                    NOISES[noise],
                    start.upper(),
                    f"{np.median(before / full):.2f}",
                    f"{np.median(after / full):.2f}",
                    p_text(update.p_value),
                    f"{np.median(by_c / full):.2f}",
                    f"{int((after < full).sum())} / {int((by_c < full).sum())} of {len(some)}",
                )
            )
            if start == "msv":
                apart.append(after / means(some, "updated"))
                continue
            helps.setdefault((code, noise), []).append(update)
            if noise == THESIS and stage == "updated" and code in BETTER_THAN_FULL:
                better.append(less(code, after, full))
    ratios = np.exp(np.mean(np.log(apart), axis=0))
    quiet = [each for (_, noise), some in helps.items() if noise == LOW for each in some]
    return Finding(
        judged(
            statements=(
                *(
                    all_of(f"the update makes the reduced {code} better", some)
                    for (code, noise), some in helps.items()
                    if noise == THESIS
                ),
                all_of("where the tables have it so, the updated model beats its full one", better),
                less(
                    "where the main modes are missing it helps less", np.ones(len(ratios)), ratios
                ),
            ),
            evidence=f"With little noise it holds in {sum(each.holds for each in quiet)} of "
            f"{len(quiet)} cases. Updated, MSV's models have {np.median(ratios):.2f} times the "
            "error of the others.",
            reason=prose("claim-3-2.reason"),
        ),
        tables=(
            SideBySide(
                "Mean error by data matching as part of the full model's, medians",
                columns(prose("claim-3-2.columns")),
                tuple(rows),
            ),
        ),
        text=(prose("claim-3-2.text", cases=", ".join(BETTER_THAN_FULL)),),
    )


def start_of(trial: ReductionTrial, stage: str) -> str:
    """Return the stage whose modes an updated one has."""
    if stage == "updated" and "updated_mrmc" in trial.stages:
        return "mrm"
    return UPDATES[stage]


def claim_unstable(found: Trials) -> Finding:
    """Compare updated models from a stable and an unstable full model of the same records."""
    rows, better, level_p = [], {}, []
    for noise, words in NOISES.items():
        for kind in KINDS:
            stable, unstable = (
                means(found[code, noise], "updated", kind) for code in (STABLE, UNSTABLE)
            )
            level = means(found[UNSTABLE, noise], LEVEL_STATES, kind)
            better[noise, kind] = less(
                f"by {MEANING[kind]} the model from the stable one is better", stable, unstable
            )
            level_p.append(sign_test(stable, level))
            rows.append(
                (
                    kind.upper(),
                    words,
                    errors_text(stable),
                    errors_text(unstable),
                    f"{int((stable < unstable).sum())} of {len(stable)}",
                    p_text(better[noise, kind].p_value),
                    errors_text(level),
                    f"{int((stable < level).sum())} of {len(stable)}",
                )
            )
    applied = [
        trial.stages["updated"].dmv_mean < trial.stages["mrmc"].dmv_mean
        for noise in NOISES
        for trial in found[UNSTABLE, noise]
    ]
    stable_one, unstable_one = EXAMPLES[STABLE], EXAMPLES[UNSTABLE]
    return Finding(
        judged(
            statements=(
                mostly("the procedure makes a model from an unstable one better", applied),
                *(each for (noise, _), each in better.items() if noise == THESIS),
            ),
            evidence="With little noise: "
            + ", ".join(
                f"{kind.upper()} {p_text(each.p_value)}"
                for (noise, kind), each in better.items()
                if noise == LOW
            )
            + ".",
            reason=prose(
                "claim-3-3.reason",
                states=unstable_one.reduced[LEVEL_STATES].order,
                held=sum(value < LEVEL for value in level_p),
                compared=len(level_p),
                **_by_sensor("stable", found, STABLE),
                **_by_sensor("unstable", found, UNSTABLE),
            ),
        ),
        tables=(
            SideBySide(
                "Mean errors of the updated models, of the same records",
                columns(prose("claim-3-3.columns", stable=STABLE, unstable=UNSTABLE)),
                tuple(rows),
            ),
        ),
        text=(
            prose(
                "claim-3-3.text",
                record=stable_one.experiment,
                states=stable_one.order,
                reduced=stable_one.reduced["updated"].order,
                unstable_states=unstable_one.order,
                unstable_reduced=unstable_one.reduced["updated"].order,
            ),
        ),
    )


def _by_sensor(word: str, found: Trials, code: str) -> dict[str, float]:
    """Return errors of the position, updated, and of the gauges, full and updated, for a reason."""
    strong, little = (found[code, noise] for noise in (THESIS, LOW))
    return {
        f"{word}_position": float(np.median(errors(strong, "updated")[:, 0])),
        f"{word}_full": float(np.median(errors(little, INITIAL)[:, 1:3])),
        f"{word}_gauges": float(np.median(errors(little, "updated")[:, 1:3])),
    }


SUBJECTS = (
    claim_subject(1, claim_mrm),
    claim_subject(4, claim_mrmc),
    claim_subject(2, claim_update),
    claim_subject(3, claim_unstable, (STABLE, UNSTABLE)),
)

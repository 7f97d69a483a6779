"""Table 3-6: the updated models that chapter 4 chooses from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

from reproduction.chapter3.examples import EXAMPLES, FILTERED, THESIS, Validation
from reproduction.chapter3.trial import RUNS_AWAY, calls, errors_text, means, trials
from reproduction.framework.findings import (
    LEVEL,
    Finding,
    SideBySide,
    columns,
    judged,
    p_text,
    prose,
    subject,
    thesis_table,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from reproduction.chapter3.examples import ReductionTrial
    from reproduction.framework.findings import Results


MEAN_NEAR = 0.25
"""A mean error agrees within a quarter: so far our own records lie from their median."""
MODEL_STAGES: Mapping[str, tuple[str, str]] = {
    "Ao2r_11": ("Ao2_19", "updated"),
    "Ao2r_7": ("Ao2_19", "further"),
    "Ao10r_9": ("Ao10_12", "updated"),
    "Ac3r_10": ("Ac3_18", "updated"),
    "Ac3r_8": ("Ac3_18", "further"),
    "Ac5r_10": ("Ac5_22", "updated"),
    "Ac6r_9": ("Ac6_29", "updated"),
    "Ac11r_10": ("Ac11_26", "updated"),
    "Ac11r_8": ("Ac11_26", "further"),
    "Ac14r_10": ("Ac14_32", "updated"),
    "Ac3r_10c": ("Ac3_22c", "updated"),
    "Ac11r_8c": ("Ac11_18c", "further"),
}
"""The example and the stage that each model of the table is."""
CODES = tuple(dict.fromkeys(code for code, _ in MODEL_STAGES.values()))


def compare_models(
    table: Mapping[str, Any],
    found: Mapping[str, Sequence[ReductionTrial]],
    filtered: Mapping[str, Sequence[ReductionTrial]],
) -> Finding:
    """Set the updated models beside the thesis's; judge those without the filtered input."""
    kinds: tuple[Validation, ...] = ("dmv", "sfv")
    theirs = {kind: [table[name][f"{kind}_mean"] for name in MODEL_STAGES] for kind in kinds}
    ours = {kind: _medians(found, kind) for kind in kinds}
    by_filter = _medians(filtered, "sfv")
    near = {kind: _count_near(theirs[kind], ours[kind]) for kind in kinds}
    order = {kind: stats.spearmanr(theirs[kind], ours[kind]) for kind in kinds}
    ranked = [bool(order[kind].statistic > 0.0 and order[kind].pvalue < LEVEL) for kind in kinds]
    others = [
        table[name]["dmv_mean"] for name, (code, _) in MODEL_STAGES.items() if code != "Ao2_19"
    ]
    runaways, runaways_filtered = (
        [name for name, value in zip(MODEL_STAGES, values, strict=True) if value > RUNS_AWAY]
        for values in (ours["sfv"], by_filter)
    )
    return Finding(
        judged(
            agrees=near["dmv"] == near["sfv"] == len(MODEL_STAGES),
            same_ranking=all(ranked),
            evidence=f"Of {len(MODEL_STAGES)} models {near['dmv']} agree within {MEAN_NEAR:.0%} by "
            f"data matching and {near['sfv']} by set-point following, "
            f"{_count_near(theirs['sfv'], by_filter)} when the input is filtered too. Rank "
            "correlation with the thesis: "
            + ", ".join(
                f"{kind.upper()} {each.statistic:.2f} ({p_text(float(each.pvalue))})"
                for kind, each in order.items()
            )
            + f". Set-point following runs away with {_names(runaways)}; with the input filtered "
            f"too with {_names(runaways_filtered)}.",
            reason=prose(
                "table-3-6.reason",
                others=len(others),
                models=len(MODEL_STAGES),
                low=min(others),
                high=max(others),
                theirs=max(others) / min(others),
                ours=_apart(found),
            ),
        ),
        tables=(
            SideBySide(
                "Mean errors; ours as median and range over the records",
                columns(prose("table-3-6.columns")),
                tuple(_row(name, table[name], found, filtered) for name in MODEL_STAGES),
            ),
        ),
        text=(prose("table-3-6.text"),),
    )


def _apart(found: Mapping[str, Sequence[ReductionTrial]]) -> float:
    """Return the factor between the errors of the records of one model, in the median."""
    errors = [means(found[code], stage, "dmv") for code, stage in MODEL_STAGES.values()]
    return float(np.median([each.max() / each.min() for each in errors]))


def _medians(found: Mapping[str, Sequence[ReductionTrial]], kind: Validation) -> list[float]:
    return [
        float(np.median(means(found[code], stage, kind))) for code, stage in MODEL_STAGES.values()
    ]


def _count_near(theirs: Sequence[float], ours: Sequence[float]) -> int:
    return sum(abs(our / their - 1.0) <= MEAN_NEAR for our, their in zip(ours, theirs, strict=True))


def _names(models: Sequence[str]) -> str:
    return ", ".join(models) or "none"


def _row(
    name: str,
    printed: Mapping[str, Any],
    found: Mapping[str, Sequence[ReductionTrial]],
    filtered: Mapping[str, Sequence[ReductionTrial]],
) -> tuple[str, ...]:
    code, stage = MODEL_STAGES[name]
    states = np.median([trial.stages[stage].order for trial in found[code]])
    return (
        name,
        EXAMPLES[code].experiment,
        printed["method"].upper(),
        f"{states:.0f}",
        f"{printed['dmv_mean']:.3f}",
        errors_text(means(found[code], stage, "dmv")),
        f"{printed['sfv_mean']:.3f}",
        errors_text(means(found[code], stage, "sfv")),
        errors_text(means(filtered[code], stage, "sfv")),
    )


def _build(results: Results) -> Finding:
    return compare_models(
        thesis_table("table_3_6"),
        *({code: trials(results, code, noise) for code in CODES} for noise in (THESIS, FILTERED)),
    )


SUBJECTS = (
    subject(
        "table-3-6",
        tuple(
            call for code in CODES for noise in (THESIS, FILTERED) for call in calls(code, noise)
        ),
        _build,
    ),
)

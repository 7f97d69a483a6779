"""Table 3-6: the updated models that chapter 4 chooses from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from reproduction.chapter3.examples import EXAMPLES, MEANING, THESIS, Validation
from reproduction.chapter3.trial import RUNS_AWAY, calls, errors_text, means, trials
from reproduction.framework.findings import (
    Finding,
    SideBySide,
    columns,
    prose,
    subject,
    thesis_table,
)
from reproduction.framework.verdicts import Beside, judged, ranked

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from reproduction.chapter3.examples import ReductionTrial
    from reproduction.framework.findings import Results


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
    table: Mapping[str, Any], found: Mapping[str, Sequence[ReductionTrial]]
) -> Finding:
    """Set the updated models beside the thesis's."""
    kinds: tuple[Validation, ...] = ("dmv", "sfv")
    theirs = {kind: [table[name][f"{kind}_mean"] for name in MODEL_STAGES] for kind in kinds}
    ours = {kind: _medians(found, kind) for kind in kinds}
    others = [
        table[name]["dmv_mean"] for name, (code, _) in MODEL_STAGES.items() if code != "Ao2_19"
    ]
    runaways = [
        name for name, value in zip(MODEL_STAGES, ours["sfv"], strict=True) if value > RUNS_AWAY
    ]
    return Finding(
        judged(
            figures=[
                Beside(f"mean errors by {words}", tuple(theirs[kind]), tuple(ours[kind]))
                for kind, words in MEANING.items()
            ],
            statements=[
                ranked(f"the models rank by {words} as in the thesis", theirs[kind], ours[kind])
                for kind, words in MEANING.items()
            ],
            evidence=f"Set-point following runs away with {', '.join(runaways) or 'none'}.",
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
                tuple(_row(name, table[name], found) for name in MODEL_STAGES),
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


def _row(
    name: str, printed: Mapping[str, Any], found: Mapping[str, Sequence[ReductionTrial]]
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
    )


def _build(results: Results) -> Finding:
    return compare_models(
        thesis_table("table_3_6"), {code: trials(results, code, THESIS) for code in CODES}
    )


SUBJECTS = (
    subject(
        "table-3-6",
        tuple(call for code in CODES for call in calls(code, THESIS)),
        _build,
    ),
)

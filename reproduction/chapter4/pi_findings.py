"""Table 4-1, Figures 4-2 to 4-5, and the claim that they carry."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.report.plots.plots import match_plot
from reproduction.chapter4.pi_evaluation import (
    CODES,
    SETPOINT_V,
    TYPE_WITHOUT_FRICTION,
    PiCase,
    pi_case,
)
from reproduction.framework.evidence import LEVEL, SEEDS, p_text, sign_test, spread
from reproduction.framework.findings import Finding, Judgement, Plot, SideBySide, judged
from reproduction.framework.subjects import Call, Subject
from reproduction.framework.thesis_values import thesis_table

if TYPE_CHECKING:
    from reproduction.framework.subjects import Results

FIGURES = dict(zip(("4-2", "4-3", "4-4", "4-5"), CODES, strict=True))
CLOSE = 0.25
"""J and Kp agree when the thesis's value is within this share of our median: its own two models of
type II differ from each other by less than 1 %, ours by seed differ by more."""
SAME_GAINS = 0.05
"""Two models count as one when their gains differ by less."""
FIGURE_MATCH = 0.06
"""Two steps that differ by less than this share of the set-point lie on each other to the eye."""

_OTHER = {code: made.type for code, made in CODES.items() if made.type != TYPE_WITHOUT_FRICTION}
_BEST = "Ac3r_10"
_TEXT = (
    "Each model is identified from the first half of its record by the thesis's ORSE with the "
    "thesis's order, reduced by MRMC with the known modes, and updated. The PI law is tuned on it "
    "by (4-1), over 5 s of a step of 1 V. Figures of ours: median and range over 20 seeds."
)
_IMPLEMENTED = (
    "The thesis does not say what compensated the friction when the laws were implemented. A model "
    "of type II knows of none, and its law alone stops where the drive no longer overcomes it; so "
    "it is implemented with the compensation of its record (0.7 V), the others without."
)


def cases(results: Results, code: str) -> list[PiCase]:
    """Return the cases of a model, one per seed."""
    return [results[Call(pi_case, (code, seed))] for seed in SEEDS]


def _needs(*codes: str) -> tuple[Call, ...]:
    return tuple(Call(pi_case, (code, seed)) for code in codes for seed in SEEDS)


def _table(results: Results) -> Finding:
    printed = thesis_table("table_4_1")
    rows = []
    for code, made in CODES.items():
        ours, thesis = cases(results, code), printed[code]
        for name, digits in (("criterion", 4), ("error_v", 4), ("rise_s", 2), ("kp", 4), ("ki", 4)):
            rows.append(
                (
                    code,
                    made.type,
                    _WORDS[name],
                    f"{thesis[name.removesuffix('_v') if name == 'error_v' else name]:.{digits}g}",
                    spread([getattr(case, name) for case in ours], f".{digits}f"),
                )
            )
    return Finding(
        table_judgement({code: cases(results, code) for code in CODES}),
        (SideBySide("PI laws", ("model", "type", "figure", "thesis", "ours"), tuple(rows)),),
        text=(_TEXT,),
    )


_WORDS = {
    "criterion": "J, V s²",
    "error_v": "steady-state error, V",
    "rise_s": "rise time, s",
    "kp": "Kp",
    "ki": "Ki, 1/s",
}


def table_judgement(ours: dict[str, list[PiCase]]) -> Judgement:
    """Judge Table 4-1 by J and Kp; Ki hardly changes J, and is not judged."""
    printed = thesis_table("table_4_1")
    ratios = {
        f"{name} of {code}": float(np.median([getattr(case, name) for case in found]))
        / printed[code][name]
        for code, found in ours.items()
        for name in ("criterion", "kp")
    }
    far = [f"{what} {ratio:.2f}" for what, ratio in ratios.items() if abs(ratio - 1.0) > CLOSE]
    best = {code: np.median([case.criterion for case in found]) for code, found in ours.items()}
    smallest = min(best[code] for code in _OTHER)
    ranked = all(
        best[code] < smallest for code, made in CODES.items() if made.type == TYPE_WITHOUT_FRICTION
    )
    small, large = (np.median([case.kp for case in ours[code]]) for code in ("Ac3r_8", "Ac3r_10"))
    apart = abs(large / small - 1.0)
    return judged(
        agrees=ranked and not far,
        same_ranking=ranked,
        evidence=(
            f"Median J is {best['Ac3r_8']:.3f} and {best['Ac3r_10']:.3f} for type II, "
            f"{best['Ao2r_9']:.3f} for type I, {best['Ac3r_10c']:.3f} for type III: type II "
            f"{'is' if ranked else 'is not'} best, as in the thesis. "
            f"Kp of the two models of type II differs by {apart:.1%}, so the third flexible mode "
            f"{'does not matter' if apart < SAME_GAINS else 'matters'}. "
            + (f"Ours over the thesis's, beyond 25 %: {', '.join(far)}." if far else "")
        ),
        reason=("The slow poles that friction leaves in a model decide J, and our arm has others."),
    )


def _figure(code: str, results: Results) -> Finding:
    found = cases(results, code)
    mismatches = [case.mismatch for case in found]
    shown = found[int(np.argsort(mismatches)[len(mismatches) // 2])]
    others = {
        other: float(np.median([case.mismatch for case in cases(results, other)]))
        for other in CODES
        if other != code
    }
    svg = match_plot(
        shown.time_s, shown.implemented_v, shown.simulated_v, "position_v", fitted_s=0.0, points=600
    )
    return Finding(
        figure_judgement(code, float(np.median(mismatches)), others),
        plots=(
            Plot(
                f"PI law of {code}, step to {SETPOINT_V:g} V: on the rig (solid) and on its model "
                f"(dotted), the seed of the median difference",
                svg,
            ),
        ),
        text=(_IMPLEMENTED,),
    )


def figure_judgement(code: str, mismatch: float, others: dict[str, float]) -> Judgement:
    """Judge a figure: type II follows its simulation, the others do not."""
    without = CODES[code].type == TYPE_WITHOUT_FRICTION
    rivals = [
        value
        for other, value in others.items()
        if (CODES[other].type == TYPE_WITHOUT_FRICTION) != without
    ]
    close = mismatch <= FIGURE_MATCH
    better = mismatch < min(rivals) if without else mismatch > max(rivals)
    return judged(
        agrees=better and close == without,
        same_ranking=better,
        evidence=(
            f"Model and rig differ by {mismatch:.1%} of the set-point (root mean square, median of "
            f"20 seeds); the other models by "
            f"{', '.join(f'{value:.1%} ({other})' for other, value in others.items())}."
        ),
        reason="The thesis's figure shows the models of type II closest to the rig.",
    )


def _claim(results: Results) -> Finding:
    mismatch = {code: [case.mismatch for case in cases(results, code)] for code in CODES}
    p_values = {code: sign_test(mismatch[_BEST], mismatch[code]) for code in _OTHER}
    rows = tuple(
        (
            code,
            made.type,
            spread([100.0 * value for value in mismatch[code]], ".1f"),
            spread([case.implemented_itae for case in cases(results, code)], ".2f"),
            p_text(p_values[code]) if code in p_values else "",
        )
        for code, made in CODES.items()
    )
    heading = ("model", "type", "difference, %", "ITAE on the rig, V s²", f"{_BEST} is closer")
    return Finding(
        claim_judgement(p_values),
        (SideBySide("Simulated and implemented step, 20 seeds", heading, rows),),
        text=(_IMPLEMENTED,),
    )


def claim_judgement(p_values: dict[str, float]) -> Judgement:
    """Judge whether the models of type II are the closest."""
    holds = max(p_values.values()) < LEVEL
    words = ", ".join(f"{code}: {p_text(value)}" for code, value in p_values.items())
    return judged(
        agrees=holds,
        same_ranking=False,
        evidence=f"The step on the rig is closer to {_BEST} than to the other types, {words}.",
        reason="At p < 0.05 it does not hold for all of them.",
    )


SUBJECTS = (
    Subject("table-4-1", "PI laws tuned on models of three types", _needs(*CODES), _table),
    *(
        Subject(
            f"figure-{number}",
            f"PI law of {code}: simulated and implemented step to 3 V",
            _needs(*CODES),
            partial(_figure, code),
        )
        for number, code in FIGURES.items()
    ),
    Subject(
        "claim-4-1",
        "Models from closed-loop data without the compensation are closest to the arm",
        _needs(*CODES),
        _claim,
    ),
)

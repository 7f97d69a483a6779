"""Tables 3-1b to 3-5b: the cost of a reduction, and the gain of an update."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V
from reproduction.chapter2.order_survey import fitted_half, identified, matched, model_of, prepared
from reproduction.chapter3.examples import (
    C_UPDATED,
    EXAMPLES,
    INITIAL,
    STAGES,
    TABLES,
    WAYS,
    Records,
    Validation,
    thesis_rows,
)
from reproduction.chapter3.trial import (
    RUNS_AWAY,
    both_calls,
    error_text,
    errors,
    errors_text,
    means,
    ratio_text,
    ratios,
    records_of,
)
from reproduction.framework.findings import (
    SENSORS,
    Call,
    Finding,
    SideBySide,
    Subject,
    columns,
    prose,
    spread,
    thesis_table,
)
from reproduction.framework.rig import run_experiment
from reproduction.framework.study_rig import study_rig
from reproduction.framework.verdicts import LEVEL, Beside, judged, p_text, ranked

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from reproduction.chapter3.examples import ReductionTrial, ThesisRow
    from reproduction.framework.findings import Results

DRIFTING = frozenset({"3-2", "3-3", "3-4"})
"""Tables beside which the errors of the full model on easier rigs stand."""
AS_IT_IS = "as it is"
_FREE = {"coulomb_friction_nm": 0.0}
RIGS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        AS_IT_IS: {},
        "little noise": {"noise_v": LOW_NOISE_V},
        "no friction": _FREE,
        "no friction, no gear play, little noise": {
            **_FREE,
            "backlash_deg": 0.0,
            "noise_v": LOW_NOISE_V,
        },
    }
)
"""Rigs by what makes them easier to model."""
_DRIFT_SEEDS = range(1, 11)


def compare_errors(rows: Sequence[ThesisRow], found: Records, *, reason: str) -> Finding:
    """Compare a model and its reduced ones with the thesis's; judge those with strong noise."""
    noisy = found.noisy
    theirs = [row.mean for row in rows]
    ours = [float(np.median(means(noisy, row.stage, row.validation))) for row in rows]
    low = [float(np.median(means(found.low, row.stage, row.validation))) for row in rows]
    sensors = [np.median(errors(noisy, row.stage, row.validation), axis=0).tolist() for row in rows]
    words = "the stages rank by their errors as in the thesis"
    return Finding(
        judged(
            figures=(
                Beside(
                    "errors of the outputs",
                    tuple(delta for row in rows for delta in row.delta),
                    tuple(error for each in sensors for error in each),
                ),
            ),
            statements=(ranked(words, theirs, ours),),
            evidence=f"Medians of {len(noisy)} records. With little noise {words}: "
            f"{p_text(ranked(words, theirs, low).p_value)}.",
            reason=reason,
        ),
        tables=(_table(rows, found), _own_table(rows, found)),
        text=_text(found),
    )


def _full_means(rows: Sequence[ThesisRow]) -> dict[Validation, float]:
    return {row.validation: row.mean for row in rows if row.stage == INITIAL}


def _table(rows: Sequence[ThesisRow], found: Records) -> SideBySide:
    full = _full_means(rows)
    return SideBySide(
        prose("table-3-xb.title", code=found.example.code, records=len(found.noisy)),
        columns(prose("table-3-xb.columns")),
        tuple(
            (
                STAGES[row.stage],
                row.validation.upper(),
                " ".join(f"{delta:.3f}" for delta in row.delta),
                f"{row.mean:.3f}",
                *_medians(found.noisy, row.stage, row.validation),
                f"{row.mean / full[row.validation]:.2f}",
                *_over_full(found, row.stage, row.validation),
            )
            for row in rows
        ),
    )


def _own_table(rows: Sequence[ThesisRow], found: Records) -> SideBySide:
    theirs = {row.stage for row in rows}
    shown: list[tuple[str, str, Validation]] = [("balanced truncation", "balanced", "dmv")]
    for name in (name for name in found.noisy[0].stages if name not in {*theirs, "balanced"}):
        label = STAGES[name.removesuffix(C_UPDATED)]
        if name.endswith(C_UPDATED):
            label += ", C instead of B"
        shown += [(label, name, "dmv"), (label, name, "sfv")]
    return SideBySide(
        prose("table-3-xb.own_title", code=found.example.code),
        ("stage", "by", "ours", "our mean", "over full", "over full, little noise"),
        tuple(
            (
                label,
                kind.upper(),
                *_medians(found.noisy, name, kind),
                *_over_full(found, name, kind),
            )
            for label, name, kind in shown
        ),
    )


def _over_full(found: Records, stage: str, kind: Validation) -> tuple[str, str]:
    return ratio_text(ratios(found.noisy, stage, kind)), ratio_text(ratios(found.low, stage, kind))


def _medians(some: Sequence[ReductionTrial], stage: str, validation: Validation) -> tuple[str, str]:
    mean = means(some, stage, validation)
    if np.median(mean) > RUNS_AWAY:
        return error_text(np.inf), errors_text(mean)
    middle = np.median(errors(some, stage, validation), axis=0)
    return " ".join(error_text(value) for value in middle.tolist()), errors_text(mean)


_ROUNDING = 1e-8
"""A smaller difference is one of rounding, and other on each processor."""


def _text(found: Records) -> tuple[str, ...]:
    example, low, noisy = found
    shown = found.shown(noisy=True)
    states = ", ".join(f"{STAGES[way]} [{', '.join(shown.stages[way].kept)}]" for way in WAYS)
    moved = sum(bool(trial.moved) for trial in noisy)
    difference = max(_ROUNDING, *(trial.realisation_difference for trial in (*low, *noisy)))
    lines = [
        prose("table-3-xb.text", states=_states(found), record=example.experiment),
        prose("table-3-xb.text2", seed=shown.seed, states=states),
        prose("table-3-xb.text3", strong=ranks_text(noisy, "mrmc"), little=ranks_text(low, "mrmc")),
        prose("table-3-xb.text4", difference=difference),
    ]
    runaways = int(np.sum(means(noisy, INITIAL, "sfv") > RUNS_AWAY))
    if runaways:
        lines.append(prose("table-3-xb.text5", runaways=runaways, records=len(noisy)))
    if moved and not example.unstable:
        lines.append(prose("table-3-xb.text6", moved=moved, records=len(noisy)))
    return tuple(lines)


def _states(found: Records) -> str:
    """Return how many states full models have; an unstable one's order is searched for."""
    if not found.example.unstable:
        return f"{found.example.order} states as the thesis's"
    orders = [trial.order for trial in found.low]
    return (
        f"{min(orders)} to {max(orders)} states with little noise, where the thesis's has "
        f"{found.example.order},"
    )


def _values(number: str, found: Records) -> dict[str, Any]:
    """Return the figures of the reasons of a table."""
    rows = {
        (row.stage, row.validation): row
        for row in thesis_rows(thesis_table(f"table_{number.replace('-', '_')}b"))
    }
    noisy = found.noisy
    sets = {way: len({trial.stages[way].kept for trial in noisy}) for way in WAYS}
    ours = {
        stage: float(np.median(errors(noisy, stage)[:, 0]))
        for stage in (INITIAL, "updated", f"updated{C_UPDATED}")
    }
    return {
        "kept": prose("table-3-x-parts.kept", records=len(noisy), **sets),
        **{f"{way}_left_out": left_out_reason(number, noisy, way) for way in ("msv", "mrmc")},
        "position": rows[INITIAL, "dmv"].delta[0],
        "updated": rows["updated", "dmv"].delta[0],
        "our_position": ours[INITIAL],
        "our_updated": ours["updated"],
        "our_c_updated": ours[f"updated{C_UPDATED}"],
        "order": found.example.order,
    }


def _subject(number: str, code: str) -> Subject:
    def build(results: Results) -> Finding:
        finding = compare_errors(
            thesis_rows(thesis_table(f"table_{number.replace('-', '_')}b")),
            records_of(results, code),
            reason=prose(
                f"table-{number}b.reason",
                plain=median_errors(code, AS_IT_IS, results)[0] if number in DRIFTING else None,
                **_values(number, records_of(results, code)),
            ),
        )
        if number not in DRIFTING:
            return finding
        values = _values(number, records_of(results, code))
        words = prose(
            "table-3-xb.drift",
            order=EXAMPLES[code].order,
            printed=values["position"],
            ours=values["our_position"],
            eased=", ".join(f"{median_errors(code, rig, results)[0]:.3f} ({rig})" for rig in RIGS),
        )
        return replace(
            finding,
            tables=(*finding.tables, drift_table(code, results)),
            text=(*finding.text, words),
        )

    return Subject(
        f"table-{number}b",
        f"{code}: reduced, updated and validated",
        both_calls(code) + (drift_calls(code) if number in DRIFTING else ()),
        build,
    )


def full_model_errors(code: str, rig: str, seed: int) -> tuple[float, ...]:
    """Return the four errors by data matching of a full model from one of the easier `RIGS`."""
    example, changed = EXAMPLES[code], RIGS[rig]
    entry = experiment(example.experiment)
    if entry.law and "coulomb_friction_nm" in changed:
        entry = replace(entry, gains={**entry.gains, "compensation_v": 0.0})
    parameters = study_rig(entry.payload_kg)
    record = prepared(
        run_experiment(entry, replace(parameters, **changed), seed), example.compensation
    )
    model, _ = model_of(identified(fitted_half(record)), example.order)
    return tuple(matched(model, record).delta.tolist())


def drift_calls(code: str) -> tuple[Call, ...]:
    """Return the computations of `drift_table`."""
    return tuple(
        Call(full_model_errors, (code, rig, seed)) for rig in RIGS for seed in _DRIFT_SEEDS
    )


def median_errors(code: str, rig: str, results: Results) -> list[float]:
    """Return the errors of the printed order, clamped where it is unstable, from one of `RIGS`."""
    found = [results[Call(full_model_errors, (code, rig, seed))] for seed in _DRIFT_SEEDS]
    middle: list[float] = np.median(found, axis=0).tolist()
    return middle


def drift_table(code: str, results: Results) -> SideBySide:
    """List the errors of the full model on easier rigs."""
    rows = [(rig, *map(error_text, median_errors(code, rig, results))) for rig in RIGS]
    return SideBySide(
        prose("table-3-xb.drift_title", seeds=len(_DRIFT_SEEDS)),
        ("rig", *SENSORS),
        tuple(rows),
    )


def ranks_text(found: Sequence[ReductionTrial], way: str) -> str:
    """Return the rank by MRM of the strongest mode left out by a way: median and range."""
    return spread([trial.left_out_rank(way) for trial in found], "g")


def thesis_rank(number: str, way: str) -> int:
    """Return the same of the tables of the thesis with a number."""
    name = f"table_{number.replace('-', '_')}"
    (row,) = (
        row for row in thesis_table(f"{name}b") if (row["stage"], row["validation"]) == (way, "dmv")
    )
    kept = row["modes"].split(",")
    modes = thesis_table(f"{name}a")["modes"]
    return min(int(mode["mrm"]) for mode in modes if mode["mode"] not in kept)


def left_out_reason(number: str, found: Sequence[ReductionTrial], way: str) -> str:
    """Compare the ranks, and tell whether a stronger mode that is left out costs more in ours."""
    return prose(
        "table-3-x-parts.left_out",
        way=way.upper(),
        theirs=thesis_rank(number, way),
        strong=ranks_text(found, way),
        correlation=_correlation(found, way),
    )


def _correlation(found: Sequence[ReductionTrial], way: str) -> str:
    ours = [trial.left_out_rank(way) for trial in found]
    if len({*ours}) == 1:
        return "that rank is the same in all of them"
    ranks = stats.spearmanr(ours, means(found, way) / means(found, INITIAL))
    falls = ranks.pvalue < LEVEL and ranks.statistic < 0.0
    return prose(
        "table-3-x-parts.correlation",
        does="falls with" if falls else "does not fall with",
        rank=ranks.statistic,
        p=p_text(float(ranks.pvalue)),
    )


SUBJECTS = tuple(_subject(number, code) for number, code in TABLES.items())

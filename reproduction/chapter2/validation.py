"""Figures 2-6 to 2-15: the order of a model, and both validations of one model per experiment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from flexarm_daq.experiments.catalogue import experiment
from flexarm_ident.models.modes import frequency_and_damping
from flexarm_ident.records.iodata import ARM_OUTPUTS, IoData
from reproduction.chapter2.easier_rigs import FREE_SEEDS, other_errors
from reproduction.chapter2.order_survey import (
    SET_POINT_COMPENSATION_V,
    SET_POINT_GAINS,
    TABLE_OF,
    fitted_half,
    followed,
    identified,
    loop_eigenvalue,
    loop_is_stable,
    matched,
    model_of,
    printed_order,
    set_point_record,
    thesis_record,
)
from reproduction.chapter2.tables import survey_calls, survey_of
from reproduction.framework.findings import (
    OFTEN,
    SEEDS,
    SENSORS,
    Call,
    Finding,
    Plot,
    SideBySide,
    Subject,
    prose,
    spread,
    subject,
    thesis_table,
)
from reproduction.framework.model_plots import match_plot, singular_value_plot
from reproduction.framework.verdicts import (
    BAND,
    Beside,
    Judgement,
    elsewhere,
    judged,
    mostly,
    not_comparable,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from reproduction.framework.findings import Results


ORDER_RECORD = "O_dat2"
"""The thesis does not say whose singular values it shows; this is the record of its Ao2_19."""
ORDER = 15
SMALL = 0.01
"""Share of the largest singular value below which a picture with a linear axis shows nothing."""
_LISTED = (1, 2, 3, 5, 7, 10, 15, 16, 20, 30)


def _singular_values(results: Results) -> Finding:
    found = survey_of(results, ORDER_RECORD)
    shares = found.singular_values / found.singular_values[:, :1]
    medians = np.median(shares, axis=0)
    rows = tuple((str(number), f"{medians[number - 1]:.2g}") for number in _LISTED)
    return Finding(
        order_judgement(medians, float(found.stable_at(ORDER).mean())),
        (SideBySide("Singular values over the largest", ("number", "ours, median"), rows),),
        (
            Plot(
                f"Singular values of {ORDER_RECORD}, seed 1",
                singular_value_plot(found.singular_values[0], ORDER),
            ),
        ),
        (prose("figure-2-6.text", order_record=ORDER_RECORD, order=ORDER),),
    )


def order_judgement(shares: NDArray[np.float64], stable: float) -> Judgement:
    """Say what the descending singular values of ours show; the thesis prints none of its own."""
    first = int(np.argmax(shares <= SMALL)) if np.any(shares <= SMALL) else len(shares)
    return not_comparable(
        f"The thesis prints no singular value, and ours show no gap at its order: they are below "
        f"{SMALL:.0%} of the largest after number {first}, and number {ORDER + 1} is "
        f"{shares[ORDER] / shares[ORDER - 1]:.0%} of number {ORDER}, medians. The model of order "
        f"{ORDER} is unstable in {1.0 - stable:.0%} of the seeds."
    )


Validation: TypeAlias = Literal["dmv", "sfv"]

CODES = {"O_dat2": "Ao2_19", "B_dat9": "Ab9_23", "C_dat2": "Ac2_35"}
SHOWN_SEED = 1
_POINTS = 600


@dataclass(frozen=True, eq=False)
class ValidatedModel:
    """Signals of both validations of a model, (samples, 4).

    Prepared outputs of the experiment and those simulated from its input; prepared outputs of the
    set-point run and those of the loop with the model.
    """

    dt_s: float
    record: NDArray[np.float32]
    dmv: NDArray[np.float32]
    set_point: NDArray[np.float32]
    sfv: NDArray[np.float32]


def validated_model(record: str) -> ValidatedModel:
    """Identify the model of the printed order from one record, and validate it in both ways."""
    whole = thesis_record(record, SHOWN_SEED)
    model, _ = model_of(identified(fitted_half(whole)), printed_order(record))
    run = set_point_record(1.0 / whole.dt_s, experiment(record).payload_kg, SHOWN_SEED)
    signals = (
        whole.y,
        matched(model, whole).y,
        run.y,
        followed(model, run).y,
    )
    with np.errstate(over="ignore"):
        return ValidatedModel(whole.dt_s, *(np.asarray(each, np.float32) for each in signals))


LATE_SAMPLES = 2
"""By so many samples the outputs of a record would stand late beside its input."""


@dataclass(frozen=True, eq=False)
class LateRecord:
    """Model of the printed order from a record whose outputs stand late, per seed.

    Whether the loop of set-point following runs away, the frequency of its largest eigenvalue, and
    the errors by data matching, (seeds, 4).
    """

    away: NDArray[np.bool_]
    loop_hz: NDArray[np.float64]
    dmv: NDArray[np.float64]


def late_record(record: str) -> LateRecord:
    """Identify the model of the printed order from outputs that stand `LATE_SAMPLES` late."""
    rows = []
    for seed in SEEDS:
        whole = thesis_record(record, seed)
        late = IoData(whole.u[LATE_SAMPLES:], whole.y[:-LATE_SAMPLES], dt_s=whole.dt_s)
        model, _ = model_of(identified(fitted_half(late)), printed_order(record))
        largest = loop_eigenvalue(model)
        swing_hz = frequency_and_damping(largest, whole.dt_s)[0] if largest.imag else 0.0
        rows.append((not loop_is_stable(model), swing_hz, matched(model, late).delta))
    return LateRecord(*map(np.array, zip(*rows, strict=True)))


def _plots(shown: ValidatedModel, validation: Validation, code: str) -> tuple[Plot, ...]:
    measured = shown.record if validation == "dmv" else shown.set_point
    simulated = shown.dmv if validation == "dmv" else shown.sfv
    time_s = np.asarray(np.arange(len(measured)) * shown.dt_s, dtype=np.float64)
    fitted_s = 0.5 * len(measured) * shown.dt_s if validation == "dmv" else 0.0
    return tuple(
        Plot(
            f"{name.removesuffix('_v').replace('_', ' ')}, {code}, seed {SHOWN_SEED}",
            match_plot(
                time_s,
                measured[:, column].astype(np.float64),
                simulated[:, column].astype(np.float64),
                name,
                fitted_s=fitted_s,
                points=_POINTS,
            ),
        )
        for column, name in enumerate(ARM_OUTPUTS)
    )


def _errors_table(
    printed: Sequence[float] | None,
    at_order: NDArray[np.float64],
    chosen: NDArray[np.float64],
    source: str,
) -> SideBySide:
    names = (*SENSORS, "mean")
    columns = [_with_mean(at_order), _with_mean(chosen)]
    thesis = [""] * len(names)
    if printed is not None:
        thesis = [f"{each:.3f}" for each in (*printed, np.mean(printed))]
    rows = [
        (name, thesis[k], *(spread(column[:, k]) for column in columns))
        for k, name in enumerate(names)
    ]
    return SideBySide(
        f"Errors, {len(SEEDS)} seeds",
        ("output", source, "ours, the thesis's order", "ours, our best order"),
        tuple(rows),
    )


def _with_mean(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([errors, errors.mean(axis=1)])


def match_judgement(
    printed: Sequence[float],
    at_order: NDArray[np.float64],
    chosen: NDArray[np.float64],
    others: Sequence[Mapping[str, NDArray[np.float64]]] = (),
) -> Judgement:
    """Judge a validation by errors, (seeds, 4), at the printed order; `chosen` is our best."""
    ours = np.median(at_order, axis=0)
    mean, best = (np.median(each.mean(axis=1)) for each in (at_order, chosen))
    return judged(
        figures=(Beside("errors of the outputs", tuple(printed), tuple(ours.tolist())),),
        evidence=f"The mean error is {np.mean(printed):.3f} in the thesis, ours {mean:.3f} "
        f"with the thesis's order and {best:.3f} with the order that is best in our record.",
        reason=_off_reason(printed, ours, others),
    )


def _off_reason(
    printed: Sequence[float],
    ours: NDArray[np.float64],
    others: Sequence[Mapping[str, NDArray[np.float64]]],
) -> str:
    """Tell the outputs outside of the band, and what becomes of each on other rigs, per seed."""
    lines = []
    for k, (theirs, here) in enumerate(zip(printed, ours.tolist(), strict=True)):
        if _is_near(here, theirs):
            continue
        words = f"{SENSORS[k].capitalize()} {here:.3f}, {theirs:.3f} in the thesis"
        if others:
            there = {rig: float(np.median([each[rig][k] for each in others])) for rig in others[0]}
            listed = ", ".join(f"{error:.3f} {rig}" for rig, error in there.items())
            near = [rig for rig, error in there.items() if _is_near(error, theirs)]
            words += f"; {listed}; in the band {' and '.join(near) or 'on none of these rigs'}"
        lines.append(words)
    return f"Outside of the band: {'. '.join(lines)}."


def _is_near(error: float, printed: float) -> bool:
    return bool(abs(np.log(error / printed)) <= np.log(BAND))


def loop_judgement(
    loop_stable: NDArray[np.bool_], errors: Sequence[float], late: LateRecord
) -> Judgement:
    """Judge Figure 2-12 by the stability of the loop, per seed; a late record may explain it."""
    return judged(
        statements=(mostly("the loop with the model runs away", ~loop_stable),),
        evidence=f"It does in {np.mean(~loop_stable):.0%} of the seeds. The errors of the outputs "
        f"are {', '.join(f'{each:.2f}' for each in errors)}.",
        reason=prose(
            "figure-2-12.reason",
            late=LATE_SAMPLES,
            does=_explains(float(np.mean(~loop_stable)), late.away),
            away=late.away.mean(),
            where=f", at {np.median(late.loop_hz[late.away]):.1f} Hz" if late.away.any() else "",
            error=np.median(late.dmv.mean(axis=1)),
        ),
    )


def _explains(away: float, late_away: NDArray[np.bool_]) -> str:
    """Return what a late record explains, by how often the loop runs away with it and without."""
    if late_away.mean() > OFTEN:
        return "would explain it"
    if late_away.mean() > away:
        return "makes it likelier, and does not explain it alone"
    return "does not explain it, and no reason is known"


def _dmv(results: Results, record: str) -> Finding:
    found = survey_of(results, record)
    order = printed_order(record)
    printed = thesis_table(TABLE_OF[record[0]])[record]["delta"]
    shown = results[Call(validated_model, (record,))]
    return Finding(
        match_judgement(
            printed,
            found.printed_dmv,
            found.chosen_dmv,
            [results[call] for call in _other_calls(record)],
        ),
        (_errors_table(printed, found.printed_dmv, found.chosen_dmv, "thesis"),),
        _plots(shown, "dmv", CODES[record]),
        (
            prose(
                "data-matching.text",
                code=CODES[record],
                order=order,
                record=record,
                stable=found.stable_at(order).mean(),
            ),
        ),
    )


def _sfv(results: Results, record: str) -> Finding:
    found = survey_of(results, record)
    printed = thesis_table("set_point_following")
    shown = results[Call(validated_model, (record,))]
    code = CODES[record]
    text = [
        prose(
            "set-point-following.text",
            kp=SET_POINT_GAINS.kp,
            kd=SET_POINT_GAINS.kd,
            set_point_compensation_v=SET_POINT_COMPENSATION_V,
        )
    ]
    if record[0] == "B":
        judgement = loop_judgement(
            found.printed_loop_stable,
            np.median(found.printed_sfv, axis=0).tolist(),
            results[Call(late_record, (record,))],
        )
        values, source = None, "thesis (not printed)"
    elif code in printed:
        values, source = printed[code], f"thesis, {code}"
        judgement = match_judgement(values, found.printed_sfv, found.chosen_sfv)
    else:
        values, source = None, "thesis (not printed)"
        judgement = elsewhere("claim-2-4", "The thesis prints no errors of it; what it shows is at")
    return Finding(
        judgement,
        (_errors_table(values, found.printed_sfv, found.chosen_sfv, source),),
        _plots(shown, "sfv", code),
        tuple(text),
    )


def _other_calls(record: str) -> tuple[Call, ...]:
    return tuple(Call(other_errors, (record, seed)) for seed in FREE_SEEDS)


def _subject(number: int, record: str, validation: Validation) -> Subject:
    build = _dmv if validation == "dmv" else _sfv
    what = "Data matching" if validation == "dmv" else "Set-point following"
    more = _other_calls(record) if validation == "dmv" else ()
    if (validation, record[0]) == ("sfv", "B"):
        more = (Call(late_record, (record,)),)
    return Subject(
        f"figure-2-{number}",
        f"{what} of {CODES[record]}",
        (*survey_calls(record), Call(validated_model, (record,)), *more),
        partial(build, record=record),
    )


SUBJECTS = (
    subject("figure-2-6", survey_calls(ORDER_RECORD), _singular_values),
    _subject(7, "O_dat2", "dmv"),
    _subject(8, "O_dat2", "sfv"),
    _subject(11, "B_dat9", "dmv"),
    _subject(12, "B_dat9", "sfv"),
    _subject(14, "C_dat2", "dmv"),
    _subject(15, "C_dat2", "sfv"),
)

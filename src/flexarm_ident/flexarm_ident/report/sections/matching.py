"""Fit sections: errors of the outputs, and the model under measured input and controller."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import label_and_unit
from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.report.content.blocks import Heading, Section, Table, Words
from flexarm_ident.report.content.match_gallery import RECORDS_SHOWN, match_gallery
from flexarm_ident.report.content.wording import error_text, short_labels

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome

_SFV = (
    "SFV is the closed-loop simulation: the controller of the experiment drives the model with the "
    "recorded set-point. "
)
_CROSS_VALIDATION = (
    "5-fold cross-validation: a model of the same estimator and order is fitted to four fifths of "
    "the data and simulates the other fifth. An overfitted model has a larger error there. "
)


def _build(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    labels = short_labels(outcome.records)
    for number, record in enumerate(outcome.records[:RECORDS_SHOWN]):
        words = (
            f"{labels[record.label]}: the model is driven by the measured input and nothing else."
        )
        if number:
            yield Heading(SECTION.title, level=2)
        elif len(outcome.records) > RECORDS_SHOWN:
            words += f" The first {RECORDS_SHOWN} of {len(outcome.records)} records are shown."
        yield Words(words)
        yield match_gallery(outcome, number, outcome.dmv[number].y, outcome.dmv[number].error)


SECTION = Section(80, "Simulation", _build)


def _followed(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    if outcome.sfv is None:
        return
    gains, first = outcome.sfv.gains, outcome.records[0]
    yield Words(
        f"{short_labels(outcome.records)[first.label]}: the controller of the experiment drives "
        f"the model with the recorded set-point, kp = {gains.kp:.3f}, kd = {gains.kd:.3f}, "
        f"ksg = {abs(gains.ksg):.3f}."
    )
    yield match_gallery(outcome, 0, outcome.sfv.y, outcome.sfv.error)


FOLLOWING = Section(
    90, "Closed-loop simulation", _followed, lambda subject: subject.outcome.sfv is not None
)


def _fitted(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    yield _errors(outcome)
    yield Words(
        "The fit is 100 (1 - NRMSE), of the simulation with the measured input (DMV): 100 % is a "
        "perfect model, 0 % is as good as the mean. The relative error δ is the RMS of measured "
        "minus simulated output, divided by the RMS of the measured output about its mean; the "
        "thesis's (2-25) takes that about zero. DMV is the simulation with the measured input. "
        + (_SFV if outcome.sfv is not None else "")
        + (_CROSS_VALIDATION if outcome.cross_validation is not None else "")
    )


FIT = Section(70, "Fit and errors", _fitted)


def _errors(outcome: Outcome) -> Table:
    """Return the relative errors of each output and their mean, as Tables 3-1b to 3-3b."""
    columns: list[tuple[str, FloatArray]] = []
    if outcome.reduction:
        columns.append(("Full, DMV", outcome.full_dmv_errors))
    if outcome.cross_validation is not None:
        columns.append(("Full, 5-fold CV", outcome.cross_validation.error))
    name = "Reduced" if outcome.reduction else "Full"
    columns.append((f"{name}, DMV", outcome.dmv_errors))
    if outcome.sfv is not None:
        columns.append((f"{name}, SFV", outcome.sfv.error))
    fit = outcome.fit_percent
    rows = [
        (
            label_and_unit(output)[0],
            _fit_text(float(fit[i])),
            *(error_text(delta[i]) for _, delta in columns),
        )
        for i, output in enumerate(outcome.records[0].outputs)
    ]
    means = (error_text(mean_error(delta)) for _, delta in columns)
    rows.append(("mean", _fit_text(mean_error(fit)), *means))
    header = ("Output", "Fit, %", *(title for title, _ in columns))
    marked = (*(False for _ in rows[1:]), True)
    return Table("errors", "Fit and relative errors δ of the outputs", header, tuple(rows), marked)


def _fit_text(fit: float) -> str:
    return f"{fit:.1f}" if np.isfinite(fit) else "-"

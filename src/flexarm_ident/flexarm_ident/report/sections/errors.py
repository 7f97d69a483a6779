"""Errors section: errors of the model by output."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import label_and_unit
from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.report.content.blocks import Section, Table, Words
from flexarm_ident.report.content.wording import error_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome


_SFV = (
    "SFV, set-point following: the model gets the recorded set-point through the control law of "
    "the experiment. "
)
_LEFT_OUT = (
    "Left out: each fifth of the fitted data is simulated by a model of the same estimator and "
    "order that was fitted to the others; a fit that follows noise has a larger error there. "
)


def _build(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    yield _errors(outcome)
    yield Words(
        "The error δ is the RMS of measured minus simulated output, divided by the RMS of the "
        "measured output about its mean. 0 is a perfect model; 1 is no better than the mean. "
        "DMV, data matching: the model gets the measured input. "
        + (_SFV if outcome.sfv is not None else "")
        + (_LEFT_OUT if outcome.cross_validation is not None else "")
        + "Fit: of the simulation for DMV, 100 (1 - NRMSE) with the output's mean removed, so that "
        "100 is a perfect model and 0 one that gives the mean."
    )


SECTION = Section(70, "Errors", _build)


def _errors(outcome: Outcome) -> Table:
    """Return the errors (2-25) of each output and their mean, as Tables 3-1b to 3-3b."""
    columns: list[tuple[str, FloatArray]] = []
    if outcome.reduction:
        columns.append(("Full, DMV", outcome.full_dmv_errors))
    if outcome.cross_validation is not None:
        columns.append(("Full, left out", outcome.cross_validation.error))
    name = "Reduced" if outcome.reduction else "Full"
    columns.append((f"{name}, DMV", outcome.dmv_errors))
    if outcome.sfv is not None:
        columns.append((f"{name}, SFV", outcome.sfv.error))
    fit = outcome.fit_percent
    rows = [
        (
            label_and_unit(output)[0],
            *(error_text(delta[i]) for _, delta in columns),
            _fit_text(float(fit[i])),
        )
        for i, output in enumerate(outcome.records[0].outputs)
    ]
    means = (error_text(mean_error(delta)) for _, delta in columns)
    rows.append(("mean", *means, _fit_text(mean_error(fit))))
    header = ("Output", *(title for title, _ in columns), "Fit, %")
    marked = (*(False for _ in rows[1:]), True)
    return Table("errors", "Errors of the outputs", header, tuple(rows), marked)


def _fit_text(fit: float) -> str:
    return f"{fit:.1f}" if np.isfinite(fit) else "-"

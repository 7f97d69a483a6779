"""Card at the top of a report: verdict, its figures, the next step, and what all this is of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.channels import CHANNEL_NAMES
from flexarm_core.labels import counted, label_and_unit
from flexarm_ident.diagnostics.verdict import fit_text
from flexarm_ident.report.content.blocks import Card, Facts
from flexarm_ident.report.content.match_gallery import first_match
from flexarm_ident.report.content.wording import listed, short_labels

if TYPE_CHECKING:
    from flexarm_ident.diagnostics.verdict import Verdict
    from flexarm_ident.report.content.blocks import Subject
    from flexarm_ident.workflow.outcome import Outcome

_NAMES_SHOWN = 3


def card(subject: Subject) -> Card:
    """Return the card of an identification."""
    outcome = subject.outcome
    found, step = outcome.verdict, outcome.verdict.next_step
    return Card(
        level=str(found.level),
        verdict=f"The model is {found.level}",
        figures=tuple(_figures(found)),
        next_step=f"{step[0].upper()}{step[1:]}.",
        facts=Facts(tuple(_facts(subject))),
        picture=first_match(outcome),
    )


def _figures(found: Verdict) -> list[tuple[str, str]]:
    worst = label_and_unit(found.worst_output)[0]
    about = (
        f"fit (NRMSE, simulation, {found.validation}); the lowest is {worst} with "
        f"{fit_text(found.worst)}"
    )
    figures = [(fit_text(found.error), about)]
    if np.isfinite(found.missed):
        words = "of the residual power is coherent with the input"
        removable = ": a better linear model could remove it" if found.avoidable else ""
        figures.append((f"{100.0 * found.missed:.0f} %", words + removable))
    return figures


def _facts(subject: Subject) -> list[tuple[str, str]]:
    outcome = subject.outcome
    names = list(short_labels(outcome.records).values())
    more = counted(len(names) - _NAMES_SHOWN, "other") if len(names) > _NAMES_SHOWN else ""
    seconds = sum(outcome.samples) * outcome.records[0].dt_s
    facts = [
        ("rig", _rig(outcome)),
        ("record", f"{listed([*names[:_NAMES_SHOWN], *filter(None, [more])])}, {seconds:.1f} s"),
        ("model", f"{counted(outcome.model.nstates, 'state')}, {outcome.identification.title}"),
    ]
    if subject.begun:
        begun = subject.begun.replace("T", " ").replace("+00:00", " UTC")
        facts.insert(2, ("recorded", begun))
    return facts


def _rig(outcome: Outcome) -> str:
    first = outcome.records[0]
    if first.outputs == CHANNEL_NAMES:
        return "flexible arm"
    inputs, outputs = (
        counted(len(each), noun)
        for each, noun in ((first.inputs, "input"), (first.outputs, "output"))
    )
    return f"{inputs}, {outputs}: {listed([label_and_unit(name)[0] for name in first.outputs[:4]])}"

"""Report summary: the model in a few sentences, and cautions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import counted
from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.records.iodata import Grade
from flexarm_ident.report.content.wording import listed, percent, shortened

if TYPE_CHECKING:
    from flexarm_ident.workflow.outcome import Outcome

_LIGHT_DAMPING = 0.2


def summary(outcome: Outcome) -> list[str]:
    """Return the outcome in a few sentences."""
    records, model = outcome.records, outcome.model
    seconds = sum(outcome.samples) * records[0].dt_s
    full = outcome.identification.order
    origin = f", reduced from {full}" if model.nstates < full else ""
    friction = " and dry friction at its inputs" if outcome.friction else ""
    error = percent(mean_error(outcome.dmv_errors))
    lines = [
        f"The model has {model.nstates} states{origin}{friction}.",
        f"It comes from {counted(len(records), 'record')} of {seconds:.1f} s in all.",
        f"Driven by the measured input alone, it misses the outputs by {error} on average.",
    ]
    if outcome.sfv is not None:
        lines.append(
            "Under the experiment's own control law, it misses them by "
            f"{percent(outcome.sfv.mean)} on average."
        )
    light = [
        f"{mode.frequency_hz:.2f} Hz"
        for mode in sorted(outcome.modes, key=lambda mode: mode.frequency_hz)
        if mode.kept and mode.is_pair and mode.damping_ratio < _LIGHT_DAMPING
    ]
    lines.append(
        f"It vibrates at {listed(light)} (damping ratio below {_LIGHT_DAMPING})."
        if light
        else f"It has no vibration with a damping ratio below {_LIGHT_DAMPING}."
    )
    return lines


def cautions(outcome: Outcome) -> list[str]:
    """Return the notes to be read before the model is used, with their grades."""
    return [text for text in _notes(outcome) if not text.startswith(Grade.INFORMATION)]


def remarks(outcome: Outcome) -> list[str]:
    """Return the notes that only inform."""
    return [text for text in _notes(outcome) if text.startswith(Grade.INFORMATION)]


def _notes(outcome: Outcome) -> list[str]:
    return [shortened(outcome, text) for text in outcome.warnings]

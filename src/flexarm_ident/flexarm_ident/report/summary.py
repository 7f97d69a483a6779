"""Report summary: the model in a few sentences, and cautions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import counted
from flexarm_ident.diagnostics.verdict import fit_text
from flexarm_ident.estimation.physical_modes import HEARD, NOISE, PHYSICAL, SPLIT, standing_of
from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.records.data_warning import Grade
from flexarm_ident.report.content.wording import listed, shortened

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.estimation.physical_modes import JudgedMode
    from flexarm_ident.models.modes import Mode
    from flexarm_ident.workflow.outcome import Outcome

_LIGHT_DAMPING = 0.2


def summary(outcome: Outcome) -> list[str]:
    """Return the outcome in a few sentences."""
    records, model = outcome.records, outcome.model
    seconds = sum(outcome.samples) * records[0].dt_s
    full = outcome.identification.order
    origin = f", reduced from {full}" if model.nstates < full else ""
    friction = " and dry friction at its inputs" if outcome.friction else ""
    fit = fit_text(mean_error(outcome.dmv_errors))
    lines = [
        f"The model has {counted(model.nstates, 'state')}{origin}{friction}.",
        f"It is estimated from {counted(len(records), 'record')}, {seconds:.1f} s in total.",
        f"The simulation with the measured input (DMV) has a fit of {fit} on average.",
    ]
    if outcome.sfv is not None:
        lines.append(
            "The closed-loop simulation with the recorded controller (SFV) has a fit of "
            f"{fit_text(mean_error(outcome.sfv.error))}."
        )
    found = outcome.identification
    return lines + vibrations(
        [mode for mode in outcome.modes if mode.kept],
        found.recurring_modes,
        is_arm=found.friction is not None,
    )


def vibrations(
    modes: Sequence[Mode], judged: Sequence[JudgedMode], *, is_arm: bool = False
) -> list[str]:
    """Return the light modes of a model, parted as the table of the modes that recur is.

    Parameters
    ----------
    modes : sequence of Mode
        Modes of the model.
    judged : sequence of JudgedMode
        Modes that recur over the orders.
    is_arm : bool
        Whether the model has an arm's equations of motion: their modes need not recur over the
        orders of linear models, which have no friction, but they must be heard.
    """
    light = _light_modes(modes, judged, is_arm=is_arm)
    lines = []
    if light[PHYSICAL]:
        lines.append(f"{_lightly_damped(light[PHYSICAL])} (damping ratio below {_LIGHT_DAMPING}).")
    if light[SPLIT]:
        lines.append(f"{_lightly_damped(light[SPLIT])}: possibly a split pole.")
    if light[NOISE]:
        why = "" if is_arm else "not repeated over the orders, or "
        lines.append(f"{_lightly_damped(light[NOISE])}: {why}hardly excited, possibly spurious.")
    return lines or [f"No lightly damped mode (damping ratio below {_LIGHT_DAMPING})."]


def _lightly_damped(frequencies_hz: Sequence[float]) -> str:
    plural = "s" if len(frequencies_hz) > 1 else ""
    words = listed([f"{frequency_hz:.2f}" for frequency_hz in frequencies_hz])
    return f"Lightly damped mode{plural} at {words} Hz"


def _light_modes(
    modes: Sequence[Mode], judged: Sequence[JudgedMode], *, is_arm: bool
) -> dict[str, list[float]]:
    """Return the frequencies of the light modes, Hz, rising, by what the modes are."""
    light = [each for each in modes if each.is_pair and each.damping_ratio < _LIGHT_DAMPING]
    strongest = max((each.mrm for each in light), default=0.0)
    found: dict[str, list[float]] = {PHYSICAL: [], SPLIT: [], NOISE: []}
    for mode in sorted(light, key=lambda each: each.frequency_hz):
        standing = standing_of(mode, judged) or NOISE
        if is_arm:
            standing = PHYSICAL if mode.mrm >= HEARD * strongest else NOISE
        found[standing].append(mode.frequency_hz)
    return found


def headline(outcome: Outcome) -> str:
    """Return level, fit, validation, order and lightly damped modes of a model in one line."""
    light = _light_modes(
        [mode for mode in outcome.modes if mode.kept],
        outcome.identification.recurring_modes,
        is_arm=outcome.identification.friction is not None,
    )
    shown = sorted([*light[PHYSICAL], *light[SPLIT]])
    modes = f", {_lightly_damped(shown)}".lower().replace("hz", "Hz") if shown else ""
    return f"{outcome.verdict.headline}, order {outcome.model.nstates}{modes}"


def cautions(outcome: Outcome) -> list[str]:
    """Return the notes to be read before the model is used, with their grades."""
    return [text for text in _notes(outcome) if not text.startswith(Grade.INFORMATION)]


def remarks(outcome: Outcome) -> list[str]:
    """Return the notes that only inform, without that word."""
    grade = f"{Grade.INFORMATION}: "
    notes = (text for text in _notes(outcome) if text.startswith(grade))
    return [text.removeprefix(grade) for text in notes]


def _notes(outcome: Outcome) -> list[str]:
    return [shortened(outcome, text) for text in outcome.warnings]

"""Report summary: the model in a few sentences, and cautions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import counted
from flexarm_ident.estimation.physical_modes import HEARD, NOISE, PHYSICAL, SPLIT, standing_of
from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.records.data_warning import Grade
from flexarm_ident.report.content.wording import listed, percent, shortened

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
    error = percent(mean_error(outcome.dmv_errors))
    lines = [
        f"The model has {counted(model.nstates, 'state')}{origin}{friction}.",
        f"It comes from {counted(len(records), 'record')} of {seconds:.1f} s in all.",
        f"Driven by the measured input alone, it misses the outputs by {error} on average.",
    ]
    if outcome.sfv is not None:
        lines.append(
            "Under the experiment's own control law, it misses them by "
            f"{percent(mean_error(outcome.sfv.error))} on average."
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
    light = [each for each in modes if each.is_pair and each.damping_ratio < _LIGHT_DAMPING]
    strongest = max((each.mrm for each in light), default=0.0)
    told: dict[str, list[str]] = {PHYSICAL: [], SPLIT: [], NOISE: []}
    for mode in sorted(light, key=lambda each: each.frequency_hz):
        standing = standing_of(mode, judged) or NOISE
        if is_arm:
            standing = PHYSICAL if mode.mrm >= HEARD * strongest else NOISE
        told[standing].append(f"{mode.frequency_hz:.2f} Hz")
    lines = []
    if told[PHYSICAL]:
        lines.append(
            f"It vibrates at {listed(told[PHYSICAL])} (damping ratio below {_LIGHT_DAMPING})."
        )
    if len(told[SPLIT]) == 1:
        lines.append(
            f"Its vibration at {told[SPLIT][0]} has a close neighbour in models of other orders: "
            "at most one of the two is the plant's."
        )
    elif told[SPLIT]:
        lines.append(
            f"Of its vibrations at {listed(told[SPLIT])}, at most one of close neighbours is the "
            "plant's."
        )
    if len(told[NOISE]) == 1:
        lines.append(
            f"Its vibration at {told[NOISE][0]} is not taken for the plant's: it "
            f"{'' if is_arm else 'does not stay over the orders, or '}hardly answers the input."
        )
    elif told[NOISE]:
        lines.append(
            f"Its vibrations at {listed(told[NOISE])} are not taken for the plant's: they "
            f"{'' if is_arm else 'do not stay over the orders, or '}hardly answer the input."
        )
    return lines or [f"It has no vibration with a damping ratio below {_LIGHT_DAMPING}."]


def cautions(outcome: Outcome) -> list[str]:
    """Return the notes to be read before the model is used, with their grades."""
    return [text for text in _notes(outcome) if not text.startswith(Grade.INFORMATION)]


def remarks(outcome: Outcome) -> list[str]:
    """Return the notes that only inform."""
    return [text for text in _notes(outcome) if text.startswith(Grade.INFORMATION)]


def _notes(outcome: Outcome) -> list[str]:
    return [shortened(outcome, text) for text in outcome.warnings]

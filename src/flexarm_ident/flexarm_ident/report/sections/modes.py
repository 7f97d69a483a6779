"""Modes section: modes of the full model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import decay, with_deviation
from flexarm_ident.report.content.blocks import Section, Table, Words
from flexarm_ident.report.content.wording import deviation_words

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome

_LARGE = 1e3


def _build(subject: Subject) -> Iterator[Block]:
    table = _modes(subject.outcome)
    yield table
    marked = " The marked modes are the reduced model." if table.marked else ""
    yield Words(
        "These are the modes of the full model. MSV is the weight of a mode in a pulse response, "
        "MRM its mean response to the recorded input; rank 1 is the largest. A mode that "
        "does not oscillate has its time constant in place of a frequency. A negative damping "
        "ratio is an unstable mode. "
        f"{deviation_words(subject.outcome)}{marked}"
    )


SECTION = Section(30, "Modes", _build)


def _modes(outcome: Outcome) -> Table:
    """Return the modes of the full model, as Tables 3-1a to 3-3a."""
    header = ("States", "Frequency, Hz", "Damping", "MSV (rank)", "MRM (rank)", "Kept")
    deviations = outcome.identification.known_deviations or [None] * len(outcome.modes)
    rows = tuple(
        (
            mode.label,
            decay(mode.eigenvalue, outcome.model.dt)
            or with_deviation(mode.frequency_hz, deviation and deviation.frequency_std_hz),
            # Without a frequency it is 1 by definition.
            with_deviation(mode.damping_ratio, (deviation and deviation.damping_std) or None),
            f"{_index(mode.msv)} ({mode.msv_rank})",
            f"{_index(mode.mrm)} ({mode.mrm_rank})",
            "yes" if mode.kept else "no",
        )
        for mode, deviation in zip(outcome.modes, deviations, strict=True)
    )
    kept = tuple(mode.kept for mode in outcome.modes)
    marked = () if all(kept) else kept
    return Table("modes", "Modes of the full model", header, rows, marked)


def _index(value: float) -> str:
    return f"{value:.3f}" if value < _LARGE else f"{value:.1e}"

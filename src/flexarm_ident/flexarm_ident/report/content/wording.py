"""Report wording: figures, lists and labels as text."""

from __future__ import annotations

import math
from itertools import groupby
from typing import TYPE_CHECKING

from flexarm_core.labels import label_and_unit
from flexarm_ident.records.naming import short_names

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.workflow.outcome import Outcome


def error_text(delta: float) -> str:
    """Return a relative error with four decimals, a dash for that of a constant output."""
    if math.isnan(delta):
        return "-"
    return f"{delta:.4f}" if math.isfinite(delta) else "∞"


def listed(words: Sequence[str]) -> str:
    """Return one or more words as a list: ``a, b and c``."""
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def sentence(words: str) -> str:
    """Return words as a sentence, with a capital and a full stop."""
    return f"{words[0].upper()}{words[1:]}."


def ranges(numbers: Iterable[int]) -> str:
    """Return rising numbers with runs joined: ``7 to 12, 14``."""
    runs = (
        [number for _, number in run]
        for _, run in groupby(enumerate(numbers), key=lambda pair: pair[1] - pair[0])
    )
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs)


def figures_text(figures: Mapping[str, float]) -> str:
    """Return named figures with their units: ``share 0.2, longest 3 s``."""
    words = []
    for key, value in figures.items():
        name, unit = label_and_unit(key)
        words.append(" ".join(filter(None, (name, f"{value:.4g}", unit))))
    return ", ".join(words)


def short_labels(records: Sequence[IoData]) -> dict[str, str]:
    """Return short names of records by their labels."""
    return short_names([record.label for record in records])


def shortened(outcome: Outcome, text: str) -> str:
    """Return a text with shortened labels of the records."""
    for label, short in short_labels(outcome.records).items():
        text = text.replace(label, short)
    return text


def deviation_words(outcome: Outcome) -> str:
    """Return the origin of the standard deviations, or the reason for their absence."""
    found = outcome.identification
    if found.likelihood is not None:
        return "± is the standard deviation, from the curvature of the likelihood."
    if found.friction is not None:
        return (
            "No standard deviation is given: an arm with dry friction is fitted by simulation, "
            "which is not done again for parts of the data."
        )
    if found.samples != tuple(len(record) for record in found.records):
        return "No standard deviation is given: the data were fitted in pieces."
    return (
        "No standard deviation is given: the residual is not noise alone, so a bias, such as "
        "that of dry friction, may be larger than the scatter."
    )

"""The rows of Tables 3-1b to 3-5b, and which of them come in another order."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

from reproduction.chapter3.reduction_calls import INITIAL

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from reproduction.chapter3.reduction_calls import Validation

DISTINCT = 0.05
"""Errors that differ by less than 5 % are level: no order is read into them."""
STAGES: Mapping[str, str] = {
    "unstable": "unstable",
    INITIAL: "initial",
    "mrm": "MRM",
    "msv": "MSV",
    "mrmc": "MRMC",
    "updated": "updated",
    "updated_mrmc": "updated, MRMC",
    "updated_msv": "updated, MSV",
    "further": "further reduced",
    "balanced": "balanced truncation",
}


@dataclass(frozen=True)
class ThesisRow:
    """A row of a table: a stage, how it was validated and its errors."""

    stage: str
    validation: Validation
    modes: str
    delta: tuple[float, ...]
    mean: float


def thesis_rows(table: Sequence[Mapping[str, Any]]) -> tuple[ThesisRow, ...]:
    """Return the rows of a table of the thesis."""
    return tuple(
        ThesisRow(
            row["stage"], row["validation"], row.get("modes", ""), tuple(row["delta"]), row["mean"]
        )
        for row in table
    )


def reversed_pairs(theirs: Mapping[str, float], ours: Mapping[str, float]) -> list[tuple[str, str]]:
    """Return the pairs of which the first is better in one and the second in the other.

    Parameters
    ----------
    theirs, ours
        Errors by name. Those that are level in either, see `DISTINCT`, are no pair.

    Returns
    -------
    list of (str, str)
        The one that is better in `theirs` first.
    """
    pairs = []
    for one, other in combinations(theirs, 2):
        better, worse = sorted((one, other), key=lambda name: theirs[name])
        distinct = theirs[worse] > (1.0 + DISTINCT) * theirs[better]
        if distinct and ours[better] > (1.0 + DISTINCT) * ours[worse]:
            pairs.append((better, worse))
    return pairs

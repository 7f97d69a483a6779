"""Distances of the figures of a rig from those of the thesis, chapter by chapter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from reproduction.calibration.figures import TRACKING
from reproduction.framework.verdicts import BAND

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from reproduction.calibration.figures import Figure

    Value = float | tuple[float, ...]

CHAPTERS = ("2", "3", "4", "B")
FARTHEST = 3.0
"""Beyond so many times the logarithm of `BAND` nothing is gained by coming a little nearer."""


@dataclass(frozen=True)
class Point:
    """A rig and how near its figures lie.

    Attributes
    ----------
    changes : dict
        Values of its parameters that were changed.
    within : dict
        Figures within `BAND`, by chapter.
    figures : dict
        Number of figures, by chapter.
    distance : float
        How far the figures lie off, in logarithms of `BAND`: mean of each chapter, and of these.
    tracking_v : float
        Largest tracking error of PDPC.
    """

    changes: Mapping[str, Value]
    within: Mapping[str, int]
    figures: Mapping[str, int]
    distance: float
    tracking_v: float

    @property
    def total(self) -> int:
        """Figures within `BAND`, of all chapters."""
        return sum(self.within.values())


def distance(figure: Figure) -> float:
    """Return how far a figure lies from the thesis's, in logarithms of `BAND`."""
    if abs(figure.ours - figure.thesis) <= figure.slack:
        return 0.0
    if min(figure.ours, figure.thesis) <= 0.0:
        return FARTHEST
    return min(float(abs(np.log(figure.ours / figure.thesis)) / np.log(BAND)), FARTHEST)


def summed(changes: Mapping[str, Value], figures: Sequence[Figure]) -> Point:
    """Sum the figures of a rig up."""
    far = {
        chapter: [distance(each) for each in figures if each.chapter == chapter]
        for chapter in CHAPTERS
    }
    return Point(
        changes,
        {chapter: sum(each <= 1.0 for each in some) for chapter, some in far.items()},
        {chapter: len(some) for chapter, some in far.items()},
        float(np.mean([np.mean(some) for some in far.values()])),
        max(each.ours for each in figures if each.name.startswith(TRACKING)),
    )

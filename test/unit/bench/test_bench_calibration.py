"""Benchmark of the study's rig: distances, and a search whose best point is known."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bench.control import calibration
from bench.control.calibration import differing, effects, search
from reproduction.calibration.figures import (
    CHAPTERS,
    FARTHEST,
    TRACKING,
    Figure,
    Point,
    distance,
    rig_of,
    summed,
)
from reproduction.framework.study_rig import STUDY_RIG

if TYPE_CHECKING:
    from collections.abc import Mapping

    from reproduction.calibration.figures import Value

GRID = {"backlash_deg": (0.1, 0.2, 0.3, 0.4), "breakaway_ratio": (1.0, 1.1, 1.2)}


def point(changes: Mapping[str, Value]) -> Point:
    """Return a point whose distance is least at 0.3 degrees and a ratio of 1.0."""
    play, ratio = changes["backlash_deg"], changes["breakaway_ratio"]
    assert isinstance(play, float)
    assert isinstance(ratio, float)
    far = abs(play - 0.3) + abs(ratio - 1.0)
    none = dict.fromkeys(CHAPTERS, 0)
    return Point(changes, none, none, far, 0.0)


def test_distance___of_figures_at_a_factor___is_in_logarithms_of_it() -> None:
    assert distance(Figure("2", "error", 0.2, 0.3)) == pytest.approx(1.0)
    assert distance(Figure("2", "error", 0.2, 0.2 / 1.5**2)) == pytest.approx(2.0)
    assert distance(Figure("2", "error", 0.01, 0.04, slack=0.05)) == 0.0
    assert distance(Figure("2", "orders", 0.0, 3.0)) == FARTHEST
    assert distance(Figure("3", "error", 0.2, math.inf)) == FARTHEST


def test_sum___of_figures___counts_those_within_the_factor_by_chapter() -> None:
    figures = [Figure(chapter, "error", 1.0, 1.2) for chapter in CHAPTERS]
    figures += [Figure("2", "error", 1.0, 2.0), Figure("4", f"{TRACKING} 0 kg", 0.0, 0.03, 0.05)]
    found = summed({}, figures)
    assert found.within == {"2": 1, "3": 1, "4": 2, "B": 1}
    assert found.figures == {"2": 2, "3": 1, "4": 2, "B": 1}
    assert (found.total, found.tracking_v) == (5, 0.03)


def test_search___of_a_bowl___ends_at_its_bottom() -> None:
    start = {"backlash_deg": 0.1, "breakaway_ratio": 1.2}
    best, measured = search(start, point, lambda _: True, GRID, passes=2)
    assert best.changes == {"backlash_deg": 0.3, "breakaway_ratio": 1.0}
    assert measured[0].changes == start
    rows = effects(best, measured)
    assert [row[0] for row in rows[:2]] == ["start: the default rig, with noise", "best found"]
    assert ("backlash_deg", "0.4") in [row[:2] for row in rows]
    # The second pass comes to the same points once more.
    assert len({row[:2] for row in rows}) == len(rows)


def test_search___of_rigs_without_a_study___does_not_take_them() -> None:
    start = {"backlash_deg": 0.1, "breakaway_ratio": 1.2}
    best, _ = search(start, point, lambda rig: rig["backlash_deg"] != 0.3, GRID, passes=2)
    assert best.changes == {"backlash_deg": 0.2, "breakaway_ratio": 1.0}


def test_search___from_a_refused_rig___says_so() -> None:
    with pytest.raises(ValueError, match="refused"):
        search({}, lambda _: None, lambda _: True, GRID, passes=1)


def test_changes___of_a_rig___are_those_from_the_study() -> None:
    values = {name: getattr(STUDY_RIG, name) for name in calibration.GRID}
    assert differing(values) == ()
    changes = differing({**values, "backlash_deg": 0.05})
    assert changes == (("backlash_deg", 0.05),)
    assert rig_of(changes).backlash_deg == pytest.approx(0.05)


def test_grid___of_each_parameter___has_the_value_of_the_study() -> None:
    for name, values in calibration.GRID.items():
        assert getattr(STUDY_RIG, name) in values

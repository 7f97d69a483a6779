from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bench.live import figures
from bench.live.figures import Phase, Row, drawn_errors_deg

ALONE = Phase(0.2, 1.0, 0.1, 0, 0, 0.1, 0, 0.0)


def phases(*reply_p99_ms: float) -> list[Phase]:
    return [replace(ALONE, reply_p99_ms=value) for value in reply_p99_ms]


def row(rows: list[Row], figure: str) -> Row:
    (found,) = (each for each in rows if each.figure == figure)
    return found


@pytest.mark.parametrize(
    ("value", "most", "least", "line", "holds"),
    [
        (49.0, None, 50.0, "at least 50 /s", "no"),
        (50.0, None, 50.0, "at least 50 /s", "yes"),
        (80.4, 80.0, None, "at most 80 /s", "no"),
        (math.nan, 80.0, None, "at most 80 /s", "no"),
        (1.0, None, None, "", ""),
    ],
)
def test_row___beside_its_line___says_whether_it_holds(
    value: float, most: float | None, least: float | None, line: str, holds: str
) -> None:
    *_, shown_line, held = Row("drawing", "frames", value, "/s", most, least).cells()
    assert (shown_line, held) == (line, holds)


def test_percentiles___of_a_hundred_values___are_rows_with_their_lines() -> None:
    lines = {50.0: None, 99.0: 98.0, 100.0: 100.0}
    rows = figures.percentile_rows("stop", "space bar", "ms", range(101), lines)
    assert [each.value for each in rows] == pytest.approx([50.0, 99.0, 100.0])
    assert [each.holds for each in rows] == [True, False, True]
    assert rows[2].figure == "space bar, largest of 101"


def test_percentiles___of_nothing___do_not_hold() -> None:
    (found,) = figures.percentile_rows("stop", "space bar", "ms", [], {50.0: 50.0})
    assert not found.holds


def test_phases___on_a_machine_that_drifts___are_compared_with_those_beside_them() -> None:
    alone = phases(1.0, 2.0, 3.0, 4.0, 5.0)
    onlookers = {"1 page": phases(1.5, 3.5), "5 pages": phases(3.0, 5.4)}
    rows = figures.loop_rows("loop", alone, onlookers, 0.05)
    one = row(rows, "1 page: reply p99 over that with nobody")
    five = row(rows, "5 pages: reply p99 over that with nobody")
    assert [one.value, five.value] == pytest.approx([1.0, 1.2])
    assert five.most == pytest.approx(1.05)
    assert (one.holds, five.holds) == (True, False)


def test_scatter___of_the_machine___widens_the_line() -> None:
    rows = figures.loop_rows("loop", phases(1.0, 3.0, 1.0), {"1 page": phases(3.0, 3.0)}, 0.05)
    assert row(rows, "1 page: reply p99 over that with nobody").most == pytest.approx(3.05)


def test_missed_periods___of_all_rounds___are_compared_with_those_of_a_bare_loop() -> None:
    watched = [replace(ALONE, missed=2, floor_missed=1), replace(ALONE, missed=0, floor_missed=0)]
    rows = figures.loop_rows("loop", phases(1.0, 1.0, 1.0), {"1 page": watched}, 0.05)
    missed = row(rows, "1 page: missed periods, line: a bare loop's")
    assert (missed.value, missed.most, missed.holds) == (2, 1, False)


def test_drawn_angle___of_a_frame___is_compared_with_the_sample_of_its_stamp() -> None:
    stamps_s = 1e9 + 0.002 * np.arange(5, dtype=np.float64)
    # 3 V are 35 degrees.
    positions_v = 0.3 * np.arange(5, dtype=np.float64)
    drawn = np.array([[stamps_s[1] + 2e-6, 3.5], [stamps_s[3] - 2e-6, 10.9], [1e9 + 0.0031, 99.0]])
    assert drawn_errors_deg(drawn, stamps_s, positions_v) == pytest.approx([0.0, 0.4])

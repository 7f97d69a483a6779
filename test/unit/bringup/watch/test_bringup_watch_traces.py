"""History and sparklines against bands and dots that were worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexarm_bringup.watch.screen import NO_BAND, Band, History, span, sparkline


def test_history___of_a_fast_sine___keeps_its_width_in_every_column() -> None:
    # 37 Hz sampled at 300 Hz: 30 samples a column are near every crest of it.
    times_s = np.arange(3000) / 300.0
    history = History()
    speed_v = np.sin(2.0 * np.pi * 37.0 * times_s)
    history.add(times_s.tolist(), {"speed_v": speed_v.tolist()})
    bands = history.bands("speed_v", 100)
    assert len(bands) == 100
    assert all(band.low < -0.97 and band.high > 0.97 for band in bands)
    assert history.newest["speed_v"] == pytest.approx(speed_v[-1])


def test_history___with_missing_samples___has_empty_columns_there() -> None:
    history = History()
    history.add([0.01, 0.02, 0.35], {"position_v": [1.0, 3.0, 2.0]})
    assert history.bands("position_v", 9) == [Band(1.0, 3.0), NO_BAND, NO_BAND, Band(2.0, 2.0)]


def test_history___value_that_is_not_known___is_left_out() -> None:
    history = History()
    history.add([0.01, 0.02, 0.03], {"reference_v": [None, 1.5, None]})
    assert history.bands("reference_v", 9) == [Band(1.5, 1.5)]
    assert math.isnan(history.newest["reference_v"])


def test_history___clock_that_goes_back___begins_anew() -> None:
    history = History()
    history.add([50.0, 50.1], {"position_v": [1.0, 1.0]})
    history.add([0.0], {"position_v": [4.0]})
    assert history.bands("position_v", 9) == [Band(4.0, 4.0)]


def test_history___clock_that_leaps___stays_bounded() -> None:
    history = History()
    history.add([0.0, 1.7e9], {"position_v": [1.0, 2.0]})
    bands = history.bands("position_v", 10_000)
    assert len(bands) == 1000
    assert bands[-1] == Band(2.0, 2.0)


@pytest.mark.parametrize(
    ("bands", "least", "expected"),
    [
        ([Band(1.0, 2.0), NO_BAND, Band(-3.0, 0.0)], 0.1, Band(-3.0, 2.0)),
        ([Band(1.0, 1.0)], 0.5, Band(0.75, 1.25)),
        ([], 2.0, Band(-1.0, 1.0)),
    ],
)
def test_span___of_bands___holds_all_of_them(
    bands: list[Band], least: float, expected: Band
) -> None:
    assert span(bands, least) == pytest.approx(expected)


def test_sparkline___of_bands___dots_every_level_between() -> None:
    # Eight levels in two rows: the whole range, the lowest, nothing, the highest.
    bands = [Band(0.0, 7.0), Band(0.0, 0.0), NO_BAND, Band(7.0, 7.0)]
    assert sparkline(bands, Band(0.0, 7.0), 2) == ["\u2847\u2808", "\u28c7\u2800"]

"""A demo that a stalled machine recorded in hard real time; its numbers tell of no hole."""

from __future__ import annotations

import numpy as np
import pytest

from flexarm_bags.check import check_bag
from flexarm_daq import RigParameters
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_ident import identify, preprocess
from flexarm_ident.reading.read import read_bag_report
from support.project import SHARED

BAG = SHARED / "data" / "stalled_demo"

pytestmark = pytest.mark.skipif(not BAG.is_dir(), reason=f"{BAG} is not there")


def test_stalled_demo___defaults___give_the_modes_of_the_arm() -> None:
    reading = read_bag_report(BAG)
    # 12854 instants of the period from the first to the last stamp, 12000 samples.
    assert reading.lost == 854
    assert {notice.code for notice in reading.data.notices} == {"lost_samples", "sampling"}
    record = preprocess(reading.data)
    found = identify(record.head(len(record) // 2), method="auto")
    modes_hz = np.array([mode.frequency_hz for mode in found.modes if mode.is_pair])
    for true_hz in natural_frequencies_hz(RigParameters())[:3]:
        assert np.abs(modes_hz / true_hz - 1.0).min() < 0.05


def test_stalled_demo___check___counts_each_period_once() -> None:
    said = " ".join(check_bag(BAG).problems)
    assert "854 periods" in said

"""Rig of the study, and the figures that it is calibrated by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexarm_daq.rigs.beam import natural_frequencies_hz
from reproduction.calibration.figures import figures_of, parts
from reproduction.chapter2.order_survey import set_point_record
from reproduction.framework.rig import simulated_record
from reproduction.framework.study_rig import CHOICES, STUDY_RIG, studied_with, study_rig

MODES_HZ = (9.0, 25.0, 48.0)
"""Of the thesis's arm, by its analysis."""


def test_rig_of_the_study___has_the_modes_of_the_thesis_within_6_percent() -> None:
    assert natural_frequencies_hz(STUDY_RIG)[:3] == pytest.approx(MODES_HZ, rel=0.06)


def test_another_rig___inside_the_block___is_the_one_of_the_study() -> None:
    quiet = replace(STUDY_RIG, noise_v=(0.0, 0.0, 0.0, 0.0))
    loud = simulated_record("C_dat3", 1).y
    with studied_with(replace(CHOICES, rig=quiet)):
        assert study_rig(0.2) == replace(quiet, payload_kg=0.2)
        calm = simulated_record("C_dat3", 1).y
        followed = set_point_record(300.0, 0.0, 1).y
    assert study_rig() == STUDY_RIG
    assert np.std(np.diff(calm[:, 1])) < 0.5 * np.std(np.diff(loud[:, 1]))
    assert not np.allclose(followed, set_point_record(300.0, 0.0, 1).y)


def test_parts___of_a_rig___are_of_all_chapters() -> None:
    kinds = {call.arguments[0] for call in parts((), (1,))}
    assert kinds == {"table", "example", "pi", "tracking", "nominal"}
    assert len(parts((), (1, 2))) == 2 * len(parts((), (1,)))


@pytest.mark.slow
def test_figures___of_a_gauge_with_half_the_gain___halve_its_gain_in_the_model() -> None:
    half = (("base_gauge_v_per_nm", 0.5 * STUDY_RIG.base_gauge_v_per_nm),)
    plain, halved = (figures_of("nominal", "0", changes, 1) for changes in ((), half))
    assert halved[1].ours == pytest.approx(0.5 * plain[1].ours, rel=0.1)
    assert halved[0].ours == pytest.approx(plain[0].ours, rel=0.1)


def test_figures___of_the_tracking___are_within_a_twentieth_of_a_volt() -> None:
    (error,) = figures_of("tracking", "0.2", (), 1)
    assert error.ours <= 0.05

"""Inputs that an experiment drives, on the thesis's arm and on one with two motors."""

from __future__ import annotations

import numpy as np
import pytest

from flexarm_core.errors import SettingError
from flexarm_core.rig_description import load_rig
from flexarm_daq.nodes.experiment_node import PARAMETERS, driven_inputs

DEFAULTS = {spec.name: spec.default for spec in PARAMETERS}
OUTPUTS = (0.0,) * 6


def commands(**values: object) -> np.ndarray:
    """Return 10 s of the commands of the arm with two motors, (samples, inputs)."""
    driven = driven_inputs(load_rig("mujoco-two-link"), {**DEFAULTS, **values})
    times_s = np.arange(5000) / 500.0
    return np.array([[each.effort(time_s, OUTPUTS) for each in driven] for time_s in times_s])


@pytest.mark.parametrize("waveform", ["multisine", "chirp", "binary_sequence", "band_noise"])
def test_magnitude_of_10_v___is_the_reach_of_each_input(waveform: str) -> None:
    found = commands(waveform=waveform, magnitude_v=10.0)

    peaks = np.abs(found).max(axis=0) / np.array([3.0, 1.0])
    assert peaks.max() <= 1.0 + 1e-9
    assert peaks.min() > 0.6
    assert abs(np.corrcoef(found.T)[0, 1]) < 0.5


def test_input_that_is_named___is_driven_alone() -> None:
    found = commands(waveform="multisine", magnitude_v=5.0, input="elbow_nm")

    assert not found[:, 0].any()
    assert np.abs(found[:, 1]).max() == pytest.approx(0.5, rel=0.02)


def test_input_that_is_none___is_refused_with_the_nearest() -> None:
    with pytest.raises(SettingError, match=r"elbow_n.*shoulder_nm, elbow_nm.*elbow_nm"):
        commands(waveform="multisine", input="elbow_n")


def test_multisine_of_all_inputs___has_one_period() -> None:
    found = commands(waveform="multisine", period_s=5.0)

    np.testing.assert_allclose(found[:2500], found[2500:], atol=1e-9)

"""The loop in one process, beside the law on the rig without loop or bag."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from flexarm_bags.check import check_bag
from flexarm_bringup.graph.processes import HeldDriveError
from flexarm_bringup.runs.direct_run import DirectRun
from flexarm_control import build_law, simulate
from flexarm_core.errors import SettingError
from flexarm_daq import RigParameters, SimulatedRig

if TYPE_CHECKING:
    from pathlib import Path

    from flexarm_daq.rigs.rig_protocol import RigSample

RATE_HZ, SAMPLES, SET_POINT_V = 300.0, 450, 2.0
STEP = {"law": "pdpc", "reference": "step", "step.amplitude_v": SET_POINT_V}


def rig() -> SimulatedRig:
    return SimulatedRig(RigParameters(loop_delay_s=6e-4), rate_hz=RATE_HZ, seed=3)


class BrokenRig(SimulatedRig):
    """A rig whose readings of the speed are none from 0.1 s on."""

    def read(self) -> RigSample:
        sample = super().read()
        if sample.time_s > 0.0999:
            sample.outputs[3] = np.nan
        return sample


def a_run(samples: int = SAMPLES, real_time_factor: float = 0.0) -> DirectRun:
    return DirectRun(rig(), RATE_HZ, samples, real_time_factor, "/lab/arm2")


def test_record___of_a_step___is_what_the_law_does_on_the_rig(tmp_path: Path) -> None:
    recorded = a_run().record(STEP, tmp_path / "bag", text="stepping")

    expected = simulate(rig(), build_law("pdpc"), np.full(SAMPLES, SET_POINT_V))
    data = recorded.reading.data
    # The last command is in force until a sample that is no more taken.
    whole = slice(SAMPLES - 1)
    np.testing.assert_array_equal(data.y, expected.y[whole])
    np.testing.assert_allclose(data.u[:, 0], expected.command_v[whole], atol=1e-12)
    assert data.reference is not None
    np.testing.assert_array_equal(data.reference, SET_POINT_V)
    assert data.compensation is not None
    np.testing.assert_allclose(data.compensation[:, 0], expected.compensation[whole], atol=1e-12)
    assert (recorded.run.taken, recorded.reading.lost, recorded.reading.unanswered) == (450, 0, 0)


def test_record___is_a_bag_without_a_problem_in_the_namespace_of_the_arm(tmp_path: Path) -> None:
    a_run(60).record(STEP, tmp_path / "bag", text="stepping")
    checked = check_bag(tmp_path / "bag")
    assert (checked.problems, checked.samples) == ((), 60)
    with AnyReader([tmp_path / "bag"]) as bag:
        names = set(bag.topics)
    assert names == {f"/lab/arm2/{name}" for name in ("state", "command", "reference", "commander")}


def test_pace___of_the_wall_clock___is_not_overtaken(tmp_path: Path) -> None:
    begun_s = time.monotonic()
    recorded = a_run(60, 1.0).record(STEP, tmp_path / "bag", text="stepping")
    assert time.monotonic() - begun_s >= 59 / RATE_HZ
    assert recorded.run.real_time_factor <= 1.01


def test_law___made_for_another_rate___is_refused_before_the_bag(tmp_path: Path) -> None:
    run = a_run()._replace(rig=SimulatedRig(rate_hz=500.0), rate_hz=500.0)
    with pytest.raises(SettingError, match=r"made for 300 Hz and the samples come at 500 Hz"):
        run.record({"law": "ilqr", "reference": "step"}, tmp_path / "bag", text="stepping")
    assert not (tmp_path / "bag").exists()


def test_drive___held_in_the_run___is_reported_with_its_time(tmp_path: Path) -> None:
    run = a_run()._replace(rig=BrokenRig(RigParameters(), rate_hz=RATE_HZ))
    # The first reading is that at 0 s.
    with pytest.raises(HeldDriveError, match=r"speed_v is not a number, after 0\.100 s of the run"):
        run.record(STEP, tmp_path / "bag", text="stepping")

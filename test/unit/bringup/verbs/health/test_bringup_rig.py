"""Verb rig check: what it tells of a description, and of a rig at rest that drives nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import main

if TYPE_CHECKING:
    from pathlib import Path

DRIVER = """\
import time

class Mine:
    def open(self):
        self.start_s = time.monotonic()

    def read(self):
        from flexarm_daq.rigs.rig_protocol import RigSample
        return RigSample(time.monotonic() - self.start_s, [90.0])

    def write(self, commands):
        raise AssertionError("nothing is to be driven")

    def safe_stop(self):
        pass

    def close(self):
        pass
"""
RIG = """\
name: mine
rate_hz: 50
inputs: {motor: {unit: V, limits: 5}}
outputs: {hub: {quantity: angle, unit: UNIT}}
JOINTS
driver: mine.py:Mine
"""
JOINTS = "joints: {hip: {input: motor, angle: hub, travel: 1.57}}"


@pytest.mark.parametrize(
    ("unit", "joints", "told"),
    [
        # 1.57 rad to either side are half a turn, and so many degrees next to nothing.
        ("rad", JOINTS, "hub, -1.57 to 1.57 rad, 0.5 turns in all"),
        ("deg", JOINTS, "hub, -1.57 to 1.57 deg (-0.0274 to 0.0274 rad), 0.00872 turns in all"),
        ("deg", "", "no joints: pd, pi, commission and C_dat need them"),
    ],
)
def test_check___of_an_own_rig___tells_its_joints_and_drives_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unit: str, joints: str, told: str
) -> None:
    monkeypatch.setattr("flexarm_bringup.verbs.health.rig._READ_S", 0.2)
    (tmp_path / "mine.py").write_text(DRIVER)
    (tmp_path / "rig.yaml").write_text(RIG.replace("UNIT", unit).replace("JOINTS", joints))
    found = CliRunner().invoke(main, ["rig", "check", str(tmp_path / "rig.yaml")])
    assert found.exit_code == 0, found.output
    assert told in found.output
    assert "stands still: no noise, or not wired" in found.output

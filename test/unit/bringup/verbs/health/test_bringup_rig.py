"""Verb rig check: what it tells of a description, and of a rig at rest that drives nothing."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import main
from flexarm_daq.drivers import at_rest
from flexarm_daq.rigs.rig_protocol import RigSample

if TYPE_CHECKING:
    from pathlib import Path

DRIVER = """\
class Mine:
    has_own_clock = True

    def open(self):
        self.count = 0

    def read(self):
        from flexarm_daq.rigs.rig_protocol import RigSample
        self.count += 1
        return RigSample(0.02 * self.count, [90.0])

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
REMEDY = (
    "and rate_hz is 50: set it to the driver's rate, or let time_s be the seconds at which each "
    "sample was taken"
)
JOINTS = "joints: {hip: {input: motor, angle: hub, travel: 1.57}}"


@pytest.mark.parametrize(
    ("unit", "joints", "reported"),
    [
        # 1.57 rad to either side are half a turn, and so many degrees next to nothing.
        ("rad", JOINTS, "hub, -1.57 to 1.57 rad, 0.5 turns in all"),
        ("deg", JOINTS, "hub, -1.57 to 1.57 deg (-0.0274 to 0.0274 rad), 0.00872 turns in all"),
        ("deg", "", "no joints: pd, pi, commission and C_dat need them"),
    ],
)
def test_check___of_an_own_rig___says_its_joints_and_drives_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unit: str, joints: str, reported: str
) -> None:
    monkeypatch.setattr("flexarm_bringup.verbs.health.rig._READ_S", 0.2)
    (tmp_path / "mine.py").write_text(DRIVER)
    (tmp_path / "rig.yaml").write_text(RIG.replace("UNIT", unit).replace("JOINTS", joints))
    found = CliRunner().invoke(main, ["rig", "check", str(tmp_path / "rig.yaml")])
    assert found.exit_code == 0, found.output
    assert reported in found.output
    assert "stands still: no noise, or not wired" in found.output


@pytest.mark.parametrize(
    ("before", "after", "reported"),
    [
        # A board of another rate, milliseconds, a wire that is off, an amplifier at its end.
        ("0.02", "0.025", f"the rig samples at 40 Hz, {REMEDY}"),
        ("0.02", "20.0", f"the rig samples at 0.05 Hz, {REMEDY}"),
        ("[90.0]", "[float('nan')]", "hub: not a number: check the wiring"),
        ("[90.0]", "[99.5]", "hub: at the end of its range: check wiring and scale"),
    ],
)
def test_check___of_a_reading_or_a_rate_of_no_use___is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: str, after: str, reported: str
) -> None:
    monkeypatch.setattr("flexarm_bringup.verbs.health.rig._READ_S", 0.2)
    (tmp_path / "mine.py").write_text(DRIVER.replace(before, after))
    rig = RIG.replace("unit: UNIT", "unit: deg, range: 100").replace("JOINTS", JOINTS)
    (tmp_path / "rig.yaml").write_text(rig)
    found = CliRunner().invoke(main, ["rig", "check", str(tmp_path / "rig.yaml")])
    assert found.exit_code == 1
    assert found.stderr == f"flexarm: {reported}\n"


@pytest.mark.parametrize(
    ("slow_s", "pace", "rate_hz"),
    [
        # The machine is late by some periods again and again, and catches up.
        (0.0, 1.0, 50.0),
        # Readings that take two periods, and a clock that runs at half the speed.
        (0.04, 1.0, 25.0),
        (0.0, 0.5, 100.0),
    ],
)
def test_check___of_a_rig_that_the_machine_paces___judges_the_rig_and_not_the_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, slow_s: float, pace: float, rate_hz: float
) -> None:
    now = 100.0

    def monotonic() -> float:
        nonlocal now
        now += 1e-6
        return now

    def sleep(wanted_s: float) -> None:
        nonlocal now
        now += wanted_s + (0.1 if round(now / 0.02) % 4 == 0 else 0.0)

    class Paced:
        def safe_stop(self) -> None:
            """Do nothing."""

        open = close = safe_stop

        def read(self) -> RigSample:
            nonlocal now
            now += slow_s
            return RigSample(pace * now, np.array([90.0]))

    (tmp_path / "mine.py").write_text(DRIVER)
    monkeypatch.setattr("flexarm_bringup.verbs.health.rig._READ_S", 0.2)
    monkeypatch.setattr("flexarm_daq.drivers.registry.driven", lambda *_: Paced())
    monkeypatch.setattr(at_rest, "time", SimpleNamespace(monotonic=monotonic, sleep=sleep))
    (tmp_path / "rig.yaml").write_text(RIG.replace("UNIT", "deg").replace("JOINTS", JOINTS))
    found = CliRunner().invoke(main, ["rig", "check", str(tmp_path / "rig.yaml")])
    reported = re.search(r"rate ([0-9.]+) Hz, 10 samples", found.output)
    assert reported is not None
    assert float(reported[1]) == pytest.approx(rate_hz, rel=1e-3)
    assert found.exit_code == (rate_hz != 50.0)
